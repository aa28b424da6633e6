//! The baked file: it comes back as it was, and whatever is not whole is refused.

mod common;

use std::path::Path;

use common::{Random, baked_sheets};
use throng_bake::baked::Baked;
use throng_bake::file::{self, from_bytes, to_bytes};
use throng_bake::sliding_tris::BandForm;

fn sheets() -> Baked {
    baked_sheets(8, BandForm::Collapsed { ratio: 1.5 })
}

fn refusal(bytes: &[u8]) -> String {
    from_bytes(Path::new("x.throng"), bytes)
        .expect_err("it must be refused")
        .to_string()
}

/// Makes the checksum and the length right again after a change.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let length = bytes.len() as u64;
    bytes[16..24].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32fast::hash(&bytes[32..]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

#[test]
fn what_is_written_comes_back_and_the_same_character_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheets.throng");
    let baked = sheets();
    file::write(&path, &baked).unwrap();
    assert_eq!(file::read(&path).unwrap(), baked);
    assert_eq!(std::fs::read(&path).unwrap(), to_bytes(&baked));
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "the temporary file is gone"
    );
}

/// What a link leads to is replaced; a device stays one.
#[cfg(unix)]
#[test]
fn links_and_devices_stay_what_they_are() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let (file, link) = (folder.path().join("a.json"), folder.path().join("link"));
    std::fs::write(&file, "old").unwrap();
    symlink(&file, &link).unwrap();
    file::write_whole(&link, b"new").unwrap();
    assert!(link.is_symlink());
    assert_eq!(std::fs::read(&file).unwrap(), b"new");
    let device = Path::new("/dev/full");
    if std::fs::metadata(device).is_ok_and(|m| m.file_type().is_char_device()) {
        let error = file::write_whole(device, b"x").unwrap_err().to_string();
        assert!(error.contains("/dev/full: cannot be written"), "{error}");
        let kind = std::fs::metadata(device).unwrap().file_type();
        assert!(kind.is_char_device());
    }
}

#[test]
fn a_folder_that_does_not_exist_is_named_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("absent").join("x.throng");
    let error = file::write(&path, &sheets()).unwrap_err().to_string();
    assert!(
        error.contains("absent") && error.contains("cannot be written"),
        "{error}"
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn every_cut_and_every_flipped_bit_is_refused() {
    let bytes = to_bytes(&sheets());
    for end in (0..bytes.len()).step_by(97) {
        assert!(
            from_bytes(Path::new("x"), &bytes[..end]).is_err(),
            "cut at {end}"
        );
    }
    let mut random = Random(1);
    for _ in 0..500 {
        let mut broken = bytes.clone();
        let at = random.below(broken.len());
        broken[at] ^= 1 << random.below(8);
        assert!(
            from_bytes(Path::new("x"), &broken).is_err(),
            "bit flipped at {at}"
        );
    }
}

#[test]
fn a_sealed_but_senseless_file_never_panics_and_what_passes_is_valid() {
    let bytes = to_bytes(&sheets());
    let mut random = Random(2);
    let mut passed = 0;
    for _ in 0..3000 {
        let mut broken = bytes.clone();
        for _ in 0..1 + random.below(3) {
            let at = 32 + random.below(broken.len() - 32);
            broken[at] = random.below(256) as u8;
        }
        if let Ok(baked) = from_bytes(Path::new("x"), &sealed(broken)) {
            passed += 1;
            throng_bake::validate::validate(&baked).unwrap();
        }
    }
    assert!(passed > 0, "a colour may change unseen");
}

/// What spoils a baked character.
type Break = fn(&mut Baked);

#[test]
fn each_broken_rule_is_named() {
    let broken: [(&str, Break); 9] = [
        ("collapse target", |b| b.collapse[5].parent = 5),
        ("collapse error", |b| b.collapse[5].error = f32::NAN),
        ("an index", |b| b.indices[0] = 60_000),
        ("indices do not exist", |b| {
            b.bands[1].index_count += 3_000_000
        }),
        ("live vertices", |b| {
            b.bands[1].vertex_count = b.bands[0].vertex_count
        }),
        ("joint", |b| b.vertices[3].joints[2] = 2),
        ("texture layer", |b| b.vertices[3].layer = 0),
        ("not finite", |b| b.palette[1].rows[0][0] = f32::INFINITY),
        ("frames times joints", |b| b.palette.truncate(7)),
    ];
    for (words, break_it) in broken {
        let mut baked = sheets();
        break_it(&mut baked);
        let error = refusal(&to_bytes(&baked));
        assert!(
            error.starts_with("x.throng: ") && error.contains(words),
            "{error}"
        );
    }
}

/// A count of indices that the packed triangles do not have, with as many digits.
#[test]
fn a_count_that_the_packed_triangles_do_not_have_is_refused() {
    let baked = sheets();
    let bytes = to_bytes(&baked);
    let count = baked.indices.len();
    let said = |count: usize| format!("\"index_count\":{count}").into_bytes();
    let old = said(count);
    let at = bytes
        .windows(old.len())
        .position(|w| w == old)
        .expect("META says it");
    let most = 10usize.pow(count.to_string().len() as u32) - 1;
    for (other, reason) in [
        (count - 1, "no whole number of triangles"),
        (count - 3, "do not unpack"),
        (most, "indices"),
    ] {
        let mut broken = bytes.clone();
        broken[at..at + old.len()].copy_from_slice(&said(other));
        let error = refusal(&sealed(broken));
        assert!(error.contains("INDX") && error.contains(reason), "{error}");
    }
}

#[test]
fn other_files_and_other_versions_are_told_apart() {
    assert!(refusal(b"glTF....").contains("not a baked character"));
    let mut newer = to_bytes(&sheets());
    newer[8] = 99;
    assert!(refusal(&newer).contains("version 99"));
}
