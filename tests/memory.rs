//! A crowd that is held for long. A test binary of its own: the memory is the whole process's.

mod common;

use common::{baked_mascot, baked_mascot_with_impostors, crowd, options, view};
use throng::gpu::{Headless, HeadlessDesc};
use throng::{CharacterId, Method};

const SIZE: [u32; 2] = [64, 48];

/// Memory of this process in KiB; `None` where the system does not tell.
fn resident_kb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Neither frames nor changes of the crowd's size, the method or the picture's size leave anything behind, nor do characters
/// that come and go. One test, because the memory is of all that run at the same time.
#[test]
fn memory_does_not_grow_over_a_thousand_frames() {
    // Without the validation layer, whose own records would be counted, too.
    let mut headless = Headless::new(&HeadlessDesc {
        size_px: SIZE,
        ..HeadlessDesc::default()
    })
    .expect("a Vulkan device");
    let id = headless.add_character(&baked_mascot()).expect("it uploads");
    let other = baked_mascot_with_impostors();
    let mut guest = None;
    let mut draw = |frame: usize| {
        if frame.is_multiple_of(5)
            && let Some(id) = guest.replace(headless.add_character(&other).expect("it uploads"))
        {
            headless.remove_character(id).expect("it is there");
        }
        let ids: Vec<CharacterId> = guest.into_iter().chain([id]).collect();
        let size = if frame % 100 < 50 { SIZE } else { [48, 64] };
        if frame.is_multiple_of(50) {
            headless.resize(size).expect("a size");
        }
        let method = match frame % 20 {
            0 => Method::Uninstanced,
            1 => Method::Full,
            n if n % 2 == 0 => Method::Hybrid,
            _ => Method::Lod,
        };
        let agents = crowd(1 + (frame * 37) % 200, &ids);
        headless
            .render(&agents, &view(size), &options(method))
            .expect("a frame");
    };
    (0..200).for_each(&mut draw);
    // Four times, because an allocator may, in some runs, take an arena for another thread: what leaks grows in all of them.
    let mut sizes = vec![resident_kb()];
    for span in 0..4 {
        (200 + 300 * span..500 + 300 * span).for_each(&mut draw);
        sizes.push(resident_kb());
    }
    let Some(sizes) = sizes.into_iter().collect::<Option<Vec<_>>>() else {
        eprintln!("SKIPPED: this system does not tell how much memory a process has");
        return;
    };
    assert!(
        sizes.windows(2).any(|s| s[1] < s[0] + 1024),
        "KiB after every 300 frames: {sizes:?}"
    );
}
