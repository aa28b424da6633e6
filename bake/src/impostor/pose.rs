//! Poses of a baked character, and where its surface is in them.

use glam::{Affine3A, Vec3};

use crate::baked::{Baked, PaletteEntry};
use crate::character::{Joint, Node};
use crate::quantize::{decode_position, decode_weights};

/// The palette of a clip at `phase`, rows interpolated between the two nearest frames as the renderer does.
pub fn palette_at(baked: &Baked, clip: usize, phase: f32) -> Vec<PaletteEntry> {
    let clip = &baked.clips[clip];
    let joint_count = baked.joints.len();
    let last = clip.frame_count - 1;
    let place = phase.clamp(0.0, 1.0) * last as f32;
    let from = (place as u32).min(last);
    let to = (from + 1).min(last);
    let u = place - from as f32;
    let frame =
        |f: u32| &baked.palette[(clip.first_frame + f) as usize * joint_count..][..joint_count];
    let mix = |(a, b): (&PaletteEntry, &PaletteEntry)| {
        let mut rows = a.rows;
        for (row, other) in rows.iter_mut().zip(b.rows) {
            for (x, y) in row.iter_mut().zip(other) {
                *x += (y - *x) * u;
            }
        }
        PaletteEntry { rows }
    };
    frame(from).iter().zip(frame(to)).map(mix).collect()
}

/// A palette that leaves everything in bind space.
pub fn bind_palette(baked: &Baked) -> Vec<PaletteEntry> {
    vec![PaletteEntry::from_affine(&Affine3A::IDENTITY); baked.joints.len()]
}

/// The nearest joint above each palette joint, as an index into `joints`.
pub fn joint_parents(nodes: &[Node], joints: &[Joint]) -> Vec<Option<usize>> {
    let mut joint_of_node: Vec<Option<usize>> = vec![None; nodes.len()];
    for (i, j) in joints.iter().enumerate() {
        joint_of_node[j.node as usize].get_or_insert(i);
    }
    let above = |node: u32| nodes[node as usize].parent;
    let parent = |j: &Joint| {
        std::iter::successors(above(j.node), |&n| above(n)).find_map(|n| joint_of_node[n as usize])
    };
    joints.iter().map(parent).collect()
}

/// Where the palette joints stand in bind space.
pub(crate) fn joint_places(joints: &[Joint]) -> Vec<Vec3> {
    let place = |j: &Joint| {
        let place = j.joint_from_bind.inverse().w_axis.truncate();
        if place.is_finite() { place } else { Vec3::ZERO }
    };
    joints.iter().map(place).collect()
}

/// Every vertex as skinning sees it.
pub(super) struct Skin {
    /// Bind space.
    pub position: Vec3,
    /// Palette joints.
    pub joints: [u8; 4],
    /// They sum to 1.
    pub weights: [f32; 4],
}

impl Skin {
    /// All vertices of the character, one for each distinct point.
    pub fn of(baked: &Baked) -> Vec<Self> {
        let mut keys: Vec<_> = baked
            .vertices
            .iter()
            .map(|v| (v.position, v.joints, v.weights))
            .collect();
        keys.sort_unstable();
        keys.dedup();
        let skin = |(position, joints, weights)| {
            let v = crate::baked::Vertex {
                position,
                ..Default::default()
            };
            Self {
                position: decode_position(&v, baked.position_min, baked.position_extent),
                joints,
                weights: decode_weights(weights),
            }
        };
        keys.into_iter().map(skin).collect()
    }

    /// Where a palette moves it.
    pub fn posed(&self, palette: &[Affine3A]) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (joint, weight) in self.joints.into_iter().zip(self.weights) {
            if weight > 0.0 {
                sum += weight * palette[joint as usize].transform_point3(self.position);
            }
        }
        sum
    }
}

/// The palette as transforms.
pub(super) fn affines(palette: &[PaletteEntry]) -> Vec<Affine3A> {
    palette.iter().map(PaletteEntry::to_affine).collect()
}

/// Points that hold all surface with a weight of at least `least` in each group, bind space: vertices, and where edges
/// cross that weight. `[group]`.
pub(super) fn group_clouds(
    baked: &Baked,
    of_joint: &[u8],
    group_count: usize,
    least: f32,
) -> Vec<Vec<Vec3>> {
    let mut clouds = vec![Vec::new(); group_count];
    for s in &baked.submeshes {
        let vertices = &baked.vertices[s.first_vertex as usize..][..s.vertex_count as usize];
        let Some(band) = baked.bands.get(s.first_band as usize) else {
            continue;
        };
        let points: Vec<(Vec3, [u8; 4], [f32; 4])> = vertices
            .iter()
            .map(|v| {
                let position = decode_position(v, baked.position_min, baked.position_extent);
                (
                    position,
                    v.joints.map(|j| of_joint[j as usize]),
                    decode_weights(v.weights),
                )
            })
            .collect();
        let weight_in = |v: usize, group: u8| {
            let (_, groups, weights) = &points[v];
            let own = groups.iter().zip(weights).filter(|(g, _)| **g == group);
            own.map(|(_, w)| w).sum::<f32>()
        };
        let mut used = vec![false; points.len()];
        let window = &baked.indices[band.first_index as usize..][..band.index_count as usize];
        for t in window.chunks_exact(3) {
            for k in 0..3 {
                let (a, b) = (t[k] as usize, t[(k + 1) % 3] as usize);
                used[a] = true;
                let mut groups: Vec<u8> = [points[a].1, points[b].1].concat();
                groups.sort_unstable();
                groups.dedup();
                for group in groups {
                    let (from, to) = (weight_in(a, group), weight_in(b, group));
                    if (from < least) != (to < least) {
                        let u = (least - from) / (to - from);
                        clouds[group as usize].push(points[a].0.lerp(points[b].0, u));
                    }
                }
            }
        }
        for v in (0..points.len()).filter(|&v| used[v]) {
            for (group, cloud) in clouds.iter_mut().enumerate() {
                if weight_in(v, group as u8) >= least {
                    cloud.push(points[v].0);
                }
            }
        }
    }
    clouds
}

/// Box of points; a point at the origin where there are none.
pub(super) fn bounds(points: impl IntoIterator<Item = Vec3>) -> (Vec3, Vec3) {
    let mut points = points.into_iter();
    let Some(first) = points.next() else {
        return (Vec3::ZERO, Vec3::ZERO);
    };
    points.fold((first, first), |(min, max), p| (min.min(p), max.max(p)))
}
