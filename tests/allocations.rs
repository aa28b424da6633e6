//! A steady frame allocates nothing, and recording one takes as long for a hundred agents as for many. A test binary of its
//! own: the allocator is the whole process's.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{baked_mascot_with_impostors, crowd, options, view};
use throng::gpu::{Headless, HeadlessDesc};
use throng::{CharacterId, FrameReport, Method};

const SIZE: [u32; 2] = [64, 48];

/// Counts what each thread allocates.
struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: hands everything on to the system's allocator; the counter is a plain thread-local number that allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        // SAFETY: the caller's contract is the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        // SAFETY: as above.
        unsafe { System.realloc(memory, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of this thread while `work` runs.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

fn with_characters() -> (Headless, Vec<CharacterId>) {
    // Without the validation layer: labels, which only it sees, are text.
    let mut headless = Headless::new(&HeadlessDesc {
        size_px: SIZE,
        ..HeadlessDesc::default()
    })
    .expect("a Vulkan device");
    let baked = [common::baked_mascot(), baked_mascot_with_impostors()];
    let ids = baked
        .iter()
        .map(|b| headless.add_character(b).expect("it uploads"));
    let ids = ids.collect();
    (headless, ids)
}

#[test]
fn allocations_are_counted() {
    assert_eq!(allocations(|| ()), 0);
    assert!(allocations(|| drop(std::hint::black_box(vec![1u8; 100]))) > 0);
}

#[test]
fn a_steady_frame_allocates_nothing() {
    let (mut headless, ids) = with_characters();
    let mut report = FrameReport::default();
    // The crowd changes, but not beyond its largest.
    let crowds = [
        crowd(1000, &ids),
        crowd(999, &ids),
        crowd(10, &ids),
        crowd(0, &ids),
    ];
    for method in [
        Method::Lod,
        Method::Full,
        Method::Flat,
        Method::Quad,
        Method::Hybrid,
    ] {
        let (view, options) = (view(SIZE), options(method));
        let mut frame = |agents: &[_]| {
            headless
                .render_into(agents, &view, &options, &mut report)
                .expect("a frame");
        };
        // The first frames make what they need.
        frame(&crowds[0]);
        frame(&crowds[0]);
        for agents in crowds.iter().cycle().take(12) {
            let count = allocations(|| frame(agents));
            assert_eq!(count, 0, "{method:?}, {} agents", agents.len());
        }
        assert_eq!(report.agents, 0);
    }
}

/// The same commands whatever the number: least of several, so that other work on the machine does not count.
#[test]
fn recording_takes_as_long_for_many_agents_as_for_few() {
    let (mut headless, ids) = with_characters();
    let mut report = FrameReport::default();
    let mut least = |count: usize| {
        let agents = crowd(count, &ids);
        let each = (0..12).map(|_| {
            headless
                .render_into(&agents, &view(SIZE), &options(Method::Hybrid), &mut report)
                .expect("a frame");
            let stage = report.stage_ms.iter().find(|s| s.stage == "record");
            stage.expect("it is measured").ms
        });
        each.fold(f64::MAX, f64::min)
    };
    let (few, many) = (least(100), least(100_000));
    assert!(few > 0.0 && many < 5.0 * few + 0.1, "{few} ms, {many} ms");
}
