//! capture: orthographic pictures of a character for its impostors. Host side of hlsl/capture.hlsl; twin in
//! [`crate::reference::capture`]. [`crate::gpu::Capturer`] draws what this file prepares: the level of detail as plain
//! triangles by group, and pages of pictures.

use std::collections::BTreeSet;

use glam::Vec2;
use throng_bake::baked::Baked;
use throng_bake::impostor::capture::{CaptureBatch, CaptureView, CapturedView};
use throng_bake::quantize::decode_weights;

use crate::error::RenderError;
use crate::gpu_types::{CAPTURE_ALL_GROUPS, CaptureInstance};
use crate::reference::mesh::living_ancestor;

/// Columns and most rows of a page, and the largest side of a picture, pixels.
pub const PAGE_SIZE: u32 = 2048;

/// Where a picture stands on its page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Which of the batch's views.
    pub view: usize,
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
}

/// Pictures that are drawn together.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Page {
    /// By group, so that a draw has the instances of one.
    pub places: Vec<Place>,
    /// Rows that they take.
    pub row_count: u32,
}

/// Triangles of a submesh that have weight in a group, in [`Level::indices`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Group, or [`CAPTURE_ALL_GROUPS`].
    pub group: u32,
    /// Submesh.
    pub submesh: usize,
    /// First index.
    pub first_index: u32,
    /// Three per triangle, at least 3.
    pub index_count: u32,
}

/// A level of detail as plain triangles.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Level {
    /// Vertex numbers within the submesh.
    pub indices: Vec<u32>,
    /// By group, then by submesh.
    pub runs: Vec<Run>,
}

/// A view's group as the shader has it.
pub fn group_of(view: &CaptureView) -> u32 {
    view.group.map_or(CAPTURE_ALL_GROUPS, u32::from)
}

/// Checks everything that pages, the shader and the twin rely on.
///
/// Errors: [`RenderError::BadOption`] with the place and the reason.
pub fn validate(baked: &Baked, batch: &CaptureBatch) -> Result<(), RenderError> {
    let bad = |reason: String| {
        Err(RenderError::BadOption {
            option: "capture batch",
            reason,
        })
    };
    let joint_count = baked.joints.len();
    if batch.groups.len() != joint_count {
        let count = batch.groups.len();
        return bad(format!(
            "{count} groups are not one for each of {joint_count} joints"
        ));
    }
    if joint_count == 0 || !batch.poses.len().is_multiple_of(joint_count) {
        let count = batch.poses.len();
        return bad(format!(
            "{count} palette entries are not poses of {joint_count} joints"
        ));
    }
    let mut numbers = batch.poses.iter().flat_map(|e| e.rows.iter().flatten());
    if !numbers.all(|x| x.is_finite()) {
        return bad("a pose has a number that is not finite".into());
    }
    if !(batch.error >= 0.0 && batch.error.is_finite()) {
        return bad(format!(
            "an error of {} is not a number of at least 0",
            batch.error
        ));
    }
    let pose_count = batch.poses.len() / joint_count;
    for (i, view) in batch.views.iter().enumerate() {
        if let Some(reason) = wrong_with(view, pose_count) {
            return bad(format!("view {i}: {reason}"));
        }
    }
    Ok(())
}

fn wrong_with(view: &CaptureView, pose_count: usize) -> Option<String> {
    /// Axes are products of a few single-precision rotations.
    const AXIS_TOLERANCE: f32 = 1e-3;
    let v = view;
    if v.pose as usize >= pose_count {
        return Some(format!("there is no pose {} of {pose_count}", v.pose));
    }
    if v.size.iter().any(|&s| s == 0 || s > PAGE_SIZE) {
        let [w, h] = v.size;
        return Some(format!("{w}x{h} pixels are not in 1 to {PAGE_SIZE}"));
    }
    if !(v.center.is_finite() && v.right.is_finite() && v.up.is_finite()) {
        return Some("its plane is not finite".into());
    }
    if (v.right.length() - 1.0).abs() > AXIS_TOLERANCE
        || (v.up.length() - 1.0).abs() > AXIS_TOLERANCE
        || v.right.dot(v.up).abs() > AXIS_TOLERANCE
    {
        return Some("right and up are not orthogonal unit vectors".into());
    }
    let extent = v.max - v.min;
    if !(extent.is_finite() && v.min.is_finite() && extent.min_element() > 0.0) {
        return Some("its edges enclose nothing".into());
    }
    if !(v.depth_extent > 0.0 && v.depth_extent.is_finite()) {
        return Some(format!(
            "a depth extent of {} is not greater than 0",
            v.depth_extent
        ));
    }
    None
}

/// The level of detail of an error (0: full detail), once for each group that a view asks for: only triangles with weight
/// in it. Every corner is moved to its living ancestor, so that nothing is left to collapse.
pub fn level(baked: &Baked, batch: &CaptureBatch) -> Level {
    let wanted: BTreeSet<u32> = batch.views.iter().map(group_of).collect();
    let triangles: Vec<Vec<[u32; 3]>> = (0..baked.submeshes.len())
        .map(|s| triangles(baked, s, batch.error))
        .collect();
    let mut level = Level::default();
    for &group in &wanted {
        for (submesh, triangles) in triangles.iter().enumerate() {
            let first_vertex = baked.submeshes[submesh].first_vertex;
            let first_index = level.indices.len() as u32;
            for triangle in triangles {
                if triangle
                    .iter()
                    .any(|v| has_weight(baked, batch, first_vertex + v, group))
                {
                    level.indices.extend(triangle);
                }
            }
            let index_count = level.indices.len() as u32 - first_index;
            if index_count > 0 {
                level.runs.push(Run {
                    group,
                    submesh,
                    first_index,
                    index_count,
                });
            }
        }
    }
    level
}

/// Triangles of a submesh at an error, from the tightest band that holds them.
fn triangles(baked: &Baked, submesh: usize, error: f32) -> Vec<[u32; 3]> {
    let s = &baked.submeshes[submesh];
    let first = s.first_vertex as usize;
    let live = live_vertex_count(baked, submesh, error);
    let bands = &baked.bands[s.first_band as usize..][..s.band_count as usize];
    let Some(band) = bands.iter().rev().find(|b| b.vertex_count >= live) else {
        return Vec::new();
    };
    baked.indices[band.first_index as usize..][..band.index_count as usize]
        .chunks_exact(3)
        .map(|t| [t[0], t[1], t[2]].map(|v| living_ancestor(baked, first, v, live).0))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect()
}

/// Vertices of a submesh that are alive at an error; all of them at 0.
pub fn live_vertex_count(baked: &Baked, submesh: usize, error: f32) -> u32 {
    let s = &baked.submeshes[submesh];
    if error <= 0.0 {
        return s.vertex_count;
    }
    let collapse = &baked.collapse[s.first_vertex as usize..][..s.vertex_count as usize];
    collapse.partition_point(|c| c.error > error) as u32
}

fn has_weight(baked: &Baked, batch: &CaptureBatch, vertex: u32, group: u32) -> bool {
    let v = &baked.vertices[vertex as usize];
    let weights = decode_weights(v.weights);
    group == CAPTURE_ALL_GROUPS
        || (v.joints.iter().zip(weights))
            .any(|(&j, w)| w > 0.0 && u32::from(batch.groups[j as usize]) == group)
}

/// Places pictures on pages, in shelves of falling height; sizes are at most [`PAGE_SIZE`].
pub fn pages(views: &[CaptureView]) -> Vec<Page> {
    let mut order: Vec<usize> = (0..views.len()).collect();
    let [width, height] = [0, 1].map(|i| move |v: &usize| std::cmp::Reverse(views[*v].size[i]));
    order.sort_by_key(|v| (height(v), width(v), *v));
    let mut pages = vec![Page::default()];
    let (mut x, mut shelf) = (0, 0..0);
    for view in order {
        let [w, h] = views[view].size;
        if x + w > PAGE_SIZE {
            (x, shelf) = (0, shelf.end..shelf.end);
        }
        if shelf.start + h > PAGE_SIZE {
            pages.push(Page::default());
            (x, shelf) = (0, 0..0);
        }
        shelf.end = shelf.end.max(shelf.start + h);
        let y = shelf.start;
        if let Some(page) = pages.last_mut() {
            page.places.push(Place { view, x, y });
            page.row_count = shelf.end;
        }
        x += w;
    }
    for page in &mut pages {
        page.places
            .sort_by_key(|p| (group_of(&views[p.view]), p.view));
    }
    pages.retain(|p| !p.places.is_empty());
    pages
}

/// What the shader reads of a picture.
pub fn instance(view: &CaptureView, place: &Place, joint_count: usize) -> CaptureInstance {
    let page = PAGE_SIZE as f32;
    let size = Vec2::new(view.size[0] as f32, view.size[1] as f32);
    // Left and bottom edge in clip space, whose y points up while rows go down.
    let clip_min = Vec2::new(
        place.x as f32 / page * 2.0 - 1.0,
        1.0 - (place.y as f32 + size.y) / page * 2.0,
    );
    let clip_size = size * (2.0 / page);
    let clip_scale = clip_size / (view.max - view.min);
    CaptureInstance {
        center: view.center.into(),
        depth_scale: 1.0 / view.depth_extent,
        right: view.right.into(),
        first_entry: view.pose * joint_count as u32,
        up: view.up.into(),
        group: group_of(view),
        clip_scale: clip_scale.into(),
        clip_offset: (clip_min - view.min * clip_scale).into(),
        clip_min: clip_min.into(),
        clip_max: (clip_min + clip_size).into(),
    }
}

/// Cuts a picture out of a page's two images, `[row_count][PAGE_SIZE]`.
pub fn cut(
    view: &CaptureView,
    place: &Place,
    color: &[[u8; 4]],
    surface: &[[u8; 4]],
) -> CapturedView {
    let [w, h] = view.size.map(|s| s as usize);
    let part = |page: &[[u8; 4]]| {
        let mut pixels = Vec::with_capacity(w * h);
        for row in 0..h {
            let first = (place.y as usize + row) * PAGE_SIZE as usize + place.x as usize;
            pixels.extend_from_slice(&page[first..first + w]);
        }
        pixels
    };
    CapturedView {
        color: part(color),
        surface: part(surface),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn view(size: [u32; 2], group: Option<u8>) -> CaptureView {
        CaptureView {
            pose: 0,
            group,
            center: Vec3::ZERO,
            right: Vec3::X,
            up: Vec3::Y,
            min: Vec2::splat(-1.0),
            max: Vec2::splat(1.0),
            depth_extent: 1.0,
            size,
        }
    }

    #[test]
    fn pictures_stand_apart_on_their_pages_and_none_is_lost() {
        let views: Vec<CaptureView> = (0..3000u32)
            .map(|i| view([1 + i * 37 % 90, 1 + i * 53 % 110], Some((i % 5) as u8)))
            .chain([view([PAGE_SIZE, PAGE_SIZE], None)])
            .collect();
        let pages = pages(&views);
        let mut seen = vec![0; views.len()];
        for page in &pages {
            let mut taken = vec![false; (PAGE_SIZE * PAGE_SIZE) as usize];
            for p in &page.places {
                seen[p.view] += 1;
                let [w, h] = views[p.view].size;
                assert!(p.x + w <= PAGE_SIZE && p.y + h <= page.row_count);
                assert!(page.row_count <= PAGE_SIZE);
                for (y, x) in (p.y..p.y + h).flat_map(|y| (p.x..p.x + w).map(move |x| (y, x))) {
                    let cell = &mut taken[(y * PAGE_SIZE + x) as usize];
                    assert!(!*cell, "two pictures share a pixel");
                    *cell = true;
                }
            }
            let groups: Vec<u32> = page
                .places
                .iter()
                .map(|p| group_of(&views[p.view]))
                .collect();
            assert!(groups.is_sorted());
        }
        assert!(seen.iter().all(|&n| n == 1));
        // 3,000 pictures of 45 x 55 pixels on the average fill two pages.
        assert!(pages.len() <= 4, "{} pages", pages.len());
        assert_eq!(super::pages(&[]), Vec::new());
    }

    #[test]
    fn a_picture_spans_its_rectangle() {
        let v = view([64, 32], None);
        let i = instance(
            &v,
            &Place {
                view: 0,
                x: 128,
                y: 1024,
            },
            7,
        );
        let clip = |p: f32, axis: usize| p * i.clip_scale[axis] + i.clip_offset[axis];
        assert_eq!([clip(-1.0, 0), clip(1.0, 0)], [-0.875, -0.8125]);
        assert_eq!([clip(1.0, 1), clip(-1.0, 1)], [0.0, -0.03125]);
        assert_eq!(i.clip_min, [-0.875, -0.03125]);
        assert_eq!(i.clip_max, [-0.8125, 0.0]);
    }

    #[test]
    fn bad_views_are_named() {
        type Case = (fn(&mut CaptureView), &'static str);
        let cases: &[Case] = &[
            (|v| v.pose = 1, "pose"),
            (|v| v.size[1] = 0, "pixels"),
            (|v| v.size[0] = PAGE_SIZE + 1, "pixels"),
            (|v| v.right = Vec3::Y, "orthogonal"),
            (|v| v.center.x = f32::NAN, "finite"),
            (|v| v.max.x = v.min.x, "edges"),
            (|v| v.depth_extent = 0.0, "depth"),
        ];
        for (change, says) in cases {
            let mut v = view([8, 8], None);
            assert_eq!(wrong_with(&v, 1), None);
            change(&mut v);
            let reason = wrong_with(&v, 1).expect("it is bad");
            assert!(reason.contains(says), "{reason}");
        }
    }
}
