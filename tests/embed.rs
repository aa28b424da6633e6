//! A host that owns everything (common/host.rs), with two frames in flight. It draws a triangle of its own before the crowd and
//! one after it, in one rendering scope. This is how to embed the library.

#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "a host is one long run of Vulkan calls on objects that it has just made; the validation layer watches"
)]

mod common;
#[path = "common/host.rs"]
mod host;

use ash::vk;
use common::{baked_mascot, crowd, options, view};
use host::{COLOR, DEPTH, FRAMES, Host, SIZE, messages};
use throng::gpu::{Renderer, RendererDesc};
use throng::{CharacterId, Method, RenderError};

#[test]
fn a_host_draws_a_crowd_between_its_own_draws() {
    unsafe {
        let host = Host::new();
        let desc = RendererDesc {
            name: "embedded crowd",
            frames_in_flight: FRAMES as u32,
            color_format: COLOR,
            depth_format: DEPTH,
            reversed_depth: false,
            ..Default::default()
        };
        let mut renderer = Renderer::new(&host.handles(), &desc).expect("a renderer");
        let mut view = view(SIZE);
        view.clip_from_view = glam::Mat4::perspective_rh(0.9, 1.5, view.near, 500.0);
        let mut characters: Vec<CharacterId> = Vec::new();
        let mut visible = Vec::new();
        for frame in 0..6 {
            let slot = frame % FRAMES;
            let (d, cmd, fence) = (&host.device, host.cmds[slot], host.fences[slot]);
            d.wait_for_fences(&[fence], true, u64::MAX).expect("waited");
            if frame >= FRAMES {
                let report = renderer.report(slot).expect("a report");
                visible.push(report.visible + report.occluded);
            }
            d.reset_fences(&[fence]).expect("reset");
            // A character comes in the middle of it, while the other slot's frame may still run.
            if frame == 0 || frame == 3 {
                characters.push(
                    renderer
                        .add_character(&baked_mascot())
                        .expect("a character"),
                );
            }
            // And one leaves, which the other slot's frame may still draw.
            if frame == 5 {
                renderer
                    .remove_character(characters.swap_remove(0))
                    .expect("it is there");
            }
            renderer.begin_frame(slot).expect("begun");
            // The crowd grows, so buffers are made anew between frames.
            renderer
                .set_agents(slot, &crowd(50 + 200 * frame, &characters))
                .expect("agents");
            d.begin_command_buffer(cmd, &vk::CommandBufferBeginInfo::default())
                .expect("recording");
            renderer.record_uploads(cmd).expect("uploads");
            renderer
                .record_select(cmd, slot, &view, &options(Method::Lod))
                .expect("selected");
            host.begin_rendering(cmd);
            host.draw_triangle(cmd);
            renderer.record_draw(cmd, slot).expect("drawn");
            host.draw_triangle(cmd);
            d.cmd_end_rendering(cmd);
            d.end_command_buffer(cmd).expect("recorded");
            let cmds = [vk::CommandBufferSubmitInfo::default().command_buffer(cmd)];
            let submit = [vk::SubmitInfo2::default().command_buffer_infos(&cmds)];
            d.queue_submit2(host.queue, &submit, fence)
                .expect("submitted");
        }
        host.device.device_wait_idle().expect("idle");
        assert!(visible.iter().all(|&v| v > 0), "{visible:?}");
        assert!(visible.is_sorted(), "the crowd grows: {visible:?}");
        renderer.destroy();
        host.destroy();
        assert_eq!(messages(), Vec::<String>::new());
    }
}

#[test]
fn calls_out_of_order_are_refused() {
    unsafe {
        let host = Host::new();
        let mut renderer =
            Renderer::new(&host.handles(), &RendererDesc::default()).expect("a renderer");
        let cmd = host.cmds[0];
        let order = |result: Result<(), RenderError>| {
            assert!(
                matches!(result, Err(RenderError::Order { .. })),
                "{result:?}"
            );
        };
        let view = view(SIZE);
        order(renderer.set_agents(0, &[]));
        order(renderer.record_select(cmd, 0, &view, &options(Method::Lod)));
        order(renderer.record_draw(cmd, 0));
        order(renderer.report(0).map(|_| ()));
        renderer
            .add_character(&baked_mascot())
            .expect("a character");
        order(renderer.record_uploads(cmd));
        assert!(matches!(
            renderer.begin_frame(9),
            Err(RenderError::BadOption { .. })
        ));
        renderer.begin_frame(0).expect("begun");
        order(renderer.record_select(cmd, 0, &view, &options(Method::Lod)));
        // A crowd from before characters came or went has to be handed in again.
        renderer.set_agents(0, &[]).expect("nobody");
        let id = renderer
            .add_character(&baked_mascot())
            .expect("a character");
        order(renderer.record_select(cmd, 0, &view, &options(Method::Lod)));
        renderer.set_agents(0, &crowd(3, &[id])).expect("agents");
        renderer.remove_character(id).expect("it is there");
        order(renderer.record_select(cmd, 0, &view, &options(Method::Lod)));
        assert!(matches!(
            renderer.set_agents(0, &crowd(3, &[id])),
            Err(RenderError::BadAgent { index: 0, .. })
        ));
        renderer.destroy();
        host.destroy();
    }
}

/// Frames overlap without hazards, and what is refused in one leaves nothing pending.
#[test]
fn frames_stream() {
    let mut headless = throng::gpu::Headless::new(&throng::gpu::HeadlessDesc {
        size_px: [96, 64],
        validation: true,
        frames_in_flight: 3,
        ..Default::default()
    })
    .expect("a device");
    let id = headless
        .add_character(&common::baked_mascot_with_impostors())
        .expect("it uploads");
    let view = view([96, 64]);
    let frame = |count| (crowd(count, &[id]), view);
    let frames: Vec<_> = [50, 300, 7, 0, 120, 90, 1000].map(frame).into();
    let hybrid = options(throng::Method::Hybrid);
    for in_flight in 1..=3 {
        let ms = headless
            .stream(&frames, &hybrid, in_flight)
            .expect("frames");
        assert_eq!(ms.len(), frames.len());
    }
    let mut bad = frames.clone();
    bad[4].0[0].scale = 0.0;
    assert!(headless.stream(&bad, &hybrid, 2).is_err());
    assert!(headless.stream(&frames, &hybrid, 4).is_err());
    assert!(headless.stream(&frames, &hybrid, 0).is_err());
    headless
        .stream(&frames, &hybrid, 2)
        .expect("the next frames");
    // A single frame has slots of its own to reuse.
    headless
        .render(&frames[0].0, &view, &hybrid)
        .expect("a frame");
    common::assert_silent(&headless);
}
