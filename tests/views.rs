//! Several views in one attachment.

#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "a host is one long run of Vulkan calls on objects that it has just made; the validation layer watches"
)]

mod common;
#[path = "common/host.rs"]
mod host;

use ash::vk;
use common::{baked_mascot_with_impostors, crowd, options};
use glam::Vec3;
use host::{COLOR, DEPTH, Host, SIZE, messages};
use throng::gpu::{Renderer, RendererDesc};
use throng::{Agent, CharacterId, Method, View};

/// Draws views into one rendering scope, each in a slot of its own, and returns the attachment.
unsafe fn draw(
    host: &Host,
    renderer: &mut Renderer,
    agents: &[Agent],
    views: &[View],
) -> Vec<[u8; 4]> {
    let (d, cmd) = (&host.device, host.cmds[0]);
    unsafe {
        d.device_wait_idle().expect("idle");
        d.begin_command_buffer(cmd, &vk::CommandBufferBeginInfo::default())
            .expect("recording");
        for slot in 0..views.len() {
            renderer.begin_frame(slot).expect("begun");
        }
        renderer.record_uploads(cmd).expect("uploads");
        let options = options(Method::Hybrid);
        for (slot, view) in views.iter().enumerate() {
            renderer.set_agents(slot, agents).expect("agents");
            renderer
                .record_select(cmd, slot, view, &options)
                .expect("selected");
        }
        host.begin_rendering(cmd);
        for slot in 0..views.len() {
            renderer.record_draw(cmd, slot).expect("drawn");
        }
        d.cmd_end_rendering(cmd);
        d.end_command_buffer(cmd).expect("recorded");
        let cmds = [vk::CommandBufferSubmitInfo::default().command_buffer(cmd)];
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(&cmds)];
        d.queue_submit2(host.queue, &submit, vk::Fence::null())
            .expect("submitted");
        host.read_color()
    }
}

/// Two views beside each other are the pictures that each of them is alone, wherever they stand, but for the device's rounding
/// (a step in 1 % of the pixels, an edge in 0.2 %), and nothing is drawn outside.
#[test]
fn views_share_an_attachment() {
    unsafe {
        let host = Host::new();
        let desc = RendererDesc {
            color_format: COLOR,
            depth_format: DEPTH,
            reversed_depth: false,
            ..Default::default()
        };
        let mut renderer = Renderer::new(&host.handles(), &desc).expect("a renderer");
        let id: CharacterId = renderer
            .add_character(&baked_mascot_with_impostors())
            .expect("a character");
        // So near that many fade from one representation into another, in a pattern of pixels.
        let mut agents = crowd(400, &[id]);
        for agent in &mut agents {
            agent.position *= 0.3;
        }
        // Not at multiples of what patterns and tiles repeat by.
        let size = [90, 101];
        let view = |eye: Vec3, offset_px: [u32; 2]| {
            let mut view = View::perspective(eye, Vec3::new(0.0, 1.0, -9.0), 0.9, 0.1, size);
            view.clip_from_view = glam::Mat4::perspective_rh(0.9, 90.0 / 101.0, 0.1, 500.0);
            view.offset_px = offset_px;
            view
        };
        let eyes = [Vec3::new(0.0, 2.0, 0.0), Vec3::new(4.0, 6.0, 1.0)];
        let places = [[3, 9], [95, 22]];
        let views = [0, 1].map(|i| view(eyes[i], places[i]));
        let both = draw(&host, &mut renderer, &agents, &views);
        let mut outside = both.clone();
        for (eye, place) in eyes.into_iter().zip(places) {
            let alone = draw(&host, &mut renderer, &agents, &[view(eye, [0, 0])]);
            let colors: std::collections::BTreeSet<_> = alone.iter().collect();
            assert!(colors.len() > 100, "something is to be seen");
            let (mut rounded, mut other) = (0, 0);
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let at = ((y + place[1]) * SIZE[0] + x + place[0]) as usize;
                    let (a, b) = (both[at], alone[(y * SIZE[0] + x) as usize]);
                    let far = a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max();
                    match far {
                        Some(0) | None => {}
                        Some(1) => rounded += 1,
                        _ => other += 1,
                    }
                    outside[at] = [0; 4];
                }
            }
            // The device adds the offset before it rounds places to its subpixels, and interpolates from there.
            assert!(
                rounded <= 90 && other <= 18,
                "at {place:?}: {rounded} pixels are off by a step, {other} by more"
            );
        }
        assert!(outside.iter().all(|p| *p == [0; 4]), "nothing outside");
        host.device.device_wait_idle().expect("idle");
        renderer.destroy();
        host.destroy();
        assert_eq!(messages(), Vec::<String>::new());
    }
}
