//! Triangles' vertex numbers as a file holds them: meshoptimizer's index codec, some two bytes a triangle where neighbours
//! stand together.

/// Bytes of the triangles in `indices`, three each; what is no whole triangle at the end is left out. Triangles keep their order
/// and their winding; which corner comes first is the codec's choice, see [`rotated`].
pub fn pack(indices: &[u32]) -> Vec<u8> {
    let whole = &indices[..indices.len() / 3 * 3];
    let vertex_count = whole.iter().max().map_or(0, |&i| i as usize + 1);
    meshopt::encode_index_buffer(whole, vertex_count).expect("the codec takes any vertex numbers")
}

/// The `count` indices that [`pack`] made `bytes` of.
///
/// Errors: the reason, where `bytes` do not hold so many. Numbers may lie outside of any range.
pub fn unpack(bytes: &[u8], count: u64) -> Result<Vec<u32>, String> {
    if !count.is_multiple_of(3) {
        return Err(format!("{count} indices are no whole number of triangles"));
    }
    // No triangle takes less than a byte: nothing is allocated for more.
    let count = usize::try_from(count)
        .ok()
        .filter(|count| count / 3 <= bytes.len())
        .ok_or_else(|| format!("{} bytes cannot hold {count} indices", bytes.len()))?;
    meshopt::decode_index_buffer(bytes, count)
        .map_err(|_| format!("{} bytes do not unpack to {count} indices", bytes.len()))
}

/// The same whole triangles with the first corners that [`pack`] keeps.
pub fn rotated(indices: &[u32]) -> Vec<u32> {
    let whole = indices.len() / 3 * 3;
    unpack(&pack(indices), whole as u64).expect("what was packed unpacks")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip, a fan, and triangles far from each other.
    fn triangles() -> Vec<u32> {
        let strip = (0..40u32).flat_map(|i| [i, i + 1 + i % 2, i + 2 - i % 2]);
        let fan = (50..90).flat_map(|i| [i + 1, 45, i]);
        let far = (0..30).flat_map(|i| [i * 7919 % 65_536, i * 104_729 % 70_000, i]);
        strip.chain(fan).chain(far).collect()
    }

    #[test]
    fn packed_triangles_come_back_with_their_winding_and_then_as_they_are() {
        let indices = triangles();
        let once = rotated(&indices);
        assert_eq!(once.len(), indices.len());
        for (a, b) in indices.chunks(3).zip(once.chunks(3)) {
            let turns = [[a[0], a[1], a[2]], [a[1], a[2], a[0]], [a[2], a[0], a[1]]];
            assert!(turns.contains(&[b[0], b[1], b[2]]), "{a:?} became {b:?}");
        }
        assert_eq!(rotated(&once), once);
        assert!(pack(&once[..240]).len() < 240);
    }

    #[test]
    fn damaged_bytes_are_refused_or_give_as_many_indices() {
        let packed = pack(&triangles());
        let count = triangles().len() as u64;
        for (bytes, count) in [
            (&packed[..], count + 1),
            (&packed[..], u64::MAX / 3 * 3),
            (&packed[..], 3 * packed.len() as u64 + 3),
            (&packed[..packed.len() / 2], count),
            (&[][..], 0),
        ] {
            assert!(unpack(bytes, count).is_err(), "{count}");
        }
        for at in 0..packed.len() {
            let mut bytes = packed.clone();
            bytes[at] ^= 0x5a;
            if let Ok(indices) = unpack(&bytes, count) {
                assert_eq!(indices.len() as u64, count);
            }
        }
    }
}
