//! `EXT_meshopt_compression` and `KHR_meshopt_compression`: unpacks a compressed buffer view.

use super::json::MeshoptView;

/// The names of the extension; the later one adds a filter and a version of the codec.
pub const EXTENSIONS: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];
/// Greatest ratio of unpacked to packed bytes that the codecs can reach (version 1 of the vertex codec: 256 elements
/// whose four byte channels never change cost one control byte).
const MAX_RATIO: usize = 1024;

/// One element of `4 * N` bytes.
#[derive(Clone)]
struct Element<const N: usize>([u32; N]);

impl<const N: usize> Default for Element<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

/// The unpacked bytes, `count * byte_stride` of them. Errors: a reason.
pub fn decompress(view: &MeshoptView, packed: &[u8]) -> Result<Vec<u8>, String> {
    let (count, stride) = (view.count, view.byte_stride);
    let size = count.checked_mul(stride).ok_or("its size overflows")?;
    if count == 0 || size / MAX_RATIO > packed.len() {
        return Err(format!(
            "{count} elements of {stride} bytes cannot come from {} packed bytes",
            packed.len()
        ));
    }
    let filter = view.filter.as_deref().unwrap_or("NONE");
    if view.mode != "ATTRIBUTES" && filter != "NONE" {
        return Err(format!("mode '{}' takes no filter", view.mode));
    }
    match (view.mode.as_str(), stride) {
        ("ATTRIBUTES", 4..=256) if stride % 4 == 0 => {
            let words = attributes(packed, count, stride / 4)?;
            apply_filter(filter, words, stride)
        }
        ("TRIANGLES" | "INDICES", 2 | 4) => {
            let triangles = view.mode == "TRIANGLES";
            if triangles && count % 3 != 0 {
                return Err(format!("its count of {count} is not a multiple of 3"));
            }
            let bytes = match (triangles, stride) {
                (true, 2) => meshopt::decode_index_buffer::<u16>(packed, count).map(bytes_of),
                (true, _) => meshopt::decode_index_buffer::<u32>(packed, count).map(bytes_of),
                (false, 2) => meshopt::decode_index_sequence::<u16>(packed, count).map(bytes_of),
                (false, _) => meshopt::decode_index_sequence::<u32>(packed, count).map(bytes_of),
            };
            bytes.map_err(|e| format!("its data is broken: {e}"))
        }
        _ => Err(format!(
            "mode '{}' with a stride of {stride} bytes does not exist",
            view.mode
        )),
    }
}

fn bytes_of<T: bytemuck::NoUninit>(values: Vec<T>) -> Vec<u8> {
    bytemuck::cast_slice(&values).to_vec()
}

/// Elements of `width` words of four bytes each.
fn attributes(packed: &[u8], count: usize, width: usize) -> Result<Vec<u32>, String> {
    fn decode<const N: usize>(packed: &[u8], count: usize) -> Result<Vec<u32>, String> {
        meshopt::decode_vertex_buffer::<Element<N>>(packed, count)
            .map(|elements| elements.iter().flat_map(|e| e.0).collect())
            .map_err(|e| format!("its data is broken: {e}"))
    }
    macro_rules! by_width {
        ($($n:literal)*) => {
            match width {
                $($n => decode::<$n>(packed, count),)*
                _ => Err(format!("a stride of {} bytes is not read", 4 * width)),
            }
        };
    }
    by_width!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}

fn apply_filter(filter: &str, mut words: Vec<u32>, stride: usize) -> Result<Vec<u8>, String> {
    match (filter, stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => {
            meshopt::decode_filter_oct::<i8>(bytemuck::cast_slice_mut(&mut words));
        }
        // Eight bytes an element: whole pairs of words, which i16 arrays may alias.
        ("OCTAHEDRAL", 8) => {
            meshopt::decode_filter_oct::<i16>(bytemuck::cast_slice_mut(&mut words));
        }
        ("QUATERNION", 8) => meshopt::decode_filter_quat(bytemuck::cast_slice_mut(&mut words)),
        ("COLOR", 4) => meshopt::decode_filter_color::<u8>(bytemuck::cast_slice_mut(&mut words)),
        ("COLOR", 8) => meshopt::decode_filter_color::<u16>(bytemuck::cast_slice_mut(&mut words)),
        ("EXPONENTIAL", _) => {
            meshopt::decode_filter_exp::<1>(bytemuck::cast_slice_mut(&mut words));
        }
        _ => {
            return Err(format!(
                "filter '{filter}' with a stride of {stride} bytes does not exist"
            ));
        }
    }
    Ok(bytes_of(words))
}
