//! Sliding-Tris: puts vertices in the order in which they die, so that vertex i is alive while i < k, and cuts index
//! windows. Source: Ramos et al. 2012, §3.1; it differs in the bands: pre-collapsed windows at geometrically spaced k,
//! closer the coarser they are, so that an instance indexes only live vertices, draws few triangles that have vanished at
//! its level, and the vertex shader follows few parents.

use std::collections::HashSet;

use crate::baked::{Band, CollapseEntry, Submesh};
use crate::error::BakeError;
use crate::indices;
use crate::mesh::{CollapseSequence, Mesh};

/// How a submesh's triangles are cut into index windows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BandForm {
    /// Windows of their own, every corner moved to its living ancestor, each with 1/ratio of the vertices of the one
    /// before, or with more where that is cheap: see [`step_ratio`].
    Collapsed {
        /// Greater than 1; near 1.1.
        ratio: f32,
    },
    /// The paper's form: one index buffer of the full mesh in the order in which triangles die; bands are prefixes of
    /// it, and the vertex shader follows the whole chain of parents.
    SingleWindow,
}

/// Submeshes in Sliding-Tris order: vertex numbers are local to their submesh, arrays are concatenated.
#[derive(Debug, Clone, Default)]
pub struct SlidingTris {
    /// Draws.
    pub submeshes: Vec<Submesh>,
    /// Vertex of the [`Mesh`] at each place.
    pub source_vertex: Vec<u32>,
    /// Parent and collapse error at each place.
    pub collapse: Vec<CollapseEntry>,
    /// Index windows.
    pub bands: Vec<Band>,
    /// Local vertex numbers.
    pub indices: Vec<u32>,
}

/// Fewest live vertices of a band that is not the last: those of a triangle.
const MIN_BAND_VERTICES: u32 = 3;
/// Share of the vertices above which all bands are a whole ratio apart.
const WIDE_SHARE: f32 = 0.25;
/// The closest that bands stand, as a power of the ratio: every band is a sub-draw, and its cost is not nothing.
const CLOSEST_POWER: f32 = 0.25;

/// Ratio of live vertices from the band with `live` of `vertex_count` vertices to the next.
///
/// An instance draws triangles that have vanished between its band's level and its own, in proportion to the logarithm of
/// the ratio; a band's bytes are in proportion to its vertices. If crowds draw as many triangles at every scale, the fewest
/// are wasted for given bytes where the logarithm of the ratio goes with the square root of the live vertices.
pub fn step_ratio(ratio: f32, live: u32, vertex_count: u32) -> f32 {
    let share = live as f32 / vertex_count.max(1) as f32;
    ratio.powf((share / WIDE_SHARE).sqrt().clamp(CLOSEST_POWER, 1.0))
}

/// Orders `mesh` by `sequence` and cuts its windows. Deterministic.
///
/// Errors: [`BakeError::Sequence`] if the sequence breaks its own rules.
pub fn order(
    mesh: &Mesh,
    sequence: &CollapseSequence,
    form: BandForm,
) -> Result<SlidingTris, BakeError> {
    let died_at = check_sequence(mesh, sequence)?;
    let mut out = SlidingTris::default();
    let mut local = vec![0u32; mesh.vertex_count()];
    for (s, info) in mesh.submeshes.iter().enumerate() {
        let mut vertices: Vec<u32> = (0..mesh.vertex_count() as u32)
            .filter(|&v| mesh.submesh[v as usize] as usize == s)
            .collect();
        // The last to die comes first; those that never die before all others.
        vertices.sort_by_key(|&v| (std::cmp::Reverse(died_at[v as usize]), v));
        for (i, &v) in vertices.iter().enumerate() {
            local[v as usize] = i as u32;
        }
        let first_vertex = out.collapse.len() as u32;
        for &v in &vertices {
            let entry = match sequence.steps.get(died_at[v as usize] as usize) {
                Some(step) => CollapseEntry {
                    parent: local[step.target as usize],
                    error: step.error_m,
                },
                None => CollapseEntry {
                    parent: local[v as usize],
                    error: f32::INFINITY,
                },
            };
            out.collapse.push(entry);
        }
        let full: Vec<[u32; 3]> = mesh
            .triangles
            .iter()
            .filter(|t| mesh.submesh[t[0] as usize] as usize == s)
            .map(|t| t.map(|v| local[v as usize]))
            .collect();
        let collapse = &out.collapse[first_vertex as usize..];
        let replacement = sequence.replacement.as_ref().map(|r| {
            let of_submesh = |t: &&[u32; 3]| mesh.submesh[t[0] as usize] as usize == s;
            let triangles = r.triangles.iter().filter(of_submesh);
            Replaced {
                live: live_count(collapse, sequence.steps[r.step].error_m),
                triangles: triangles.map(|t| t.map(|v| local[v as usize])).collect(),
            }
        });
        let windows = Windows {
            collapse,
            place: places(mesh, &vertices),
            full,
            replacement,
        };
        let first_band = out.bands.len() as u32;
        windows.cut(form, &mut out.bands, &mut out.indices);
        out.source_vertex.extend_from_slice(&vertices);
        out.submeshes.push(Submesh {
            info: info.clone(),
            first_vertex,
            vertex_count: vertices.len() as u32,
            first_band,
            band_count: out.bands.len() as u32 - first_band,
        });
    }
    out.indices = indices::rotated(&out.indices);
    Ok(out)
}

/// Step at which each vertex dies, `u32::MAX` for never.
fn check_sequence(mesh: &Mesh, sequence: &CollapseSequence) -> Result<Vec<u32>, BakeError> {
    let n = mesh.vertex_count();
    let mut died_at = vec![u32::MAX; n];
    let mut last = 0.0f32;
    for (i, step) in sequence.steps.iter().enumerate() {
        let (v, t) = (step.vertex as usize, step.target as usize);
        let reason = if v >= n || t >= n || v == t {
            "it names a vertex that does not exist, or the vertex itself"
        } else if died_at[v] != u32::MAX || died_at[t] != u32::MAX {
            "its vertex or its target is dead already"
        } else if mesh.submesh[v] != mesh.submesh[t] {
            "its target lies in another submesh"
        } else if !step.error_m.is_finite() || step.error_m < last {
            "its error falls or is not finite"
        } else {
            died_at[v] = i as u32;
            last = step.error_m;
            continue;
        };
        return Err(BakeError::Sequence { step: i, reason });
    }
    if let Some(r) = &sequence.replacement {
        let error = sequence.steps.get(r.step).map(|s| s.error_m);
        let alive = |v: u32| {
            let death = died_at.get(v as usize)?;
            let step = sequence.steps.get(*death as usize);
            Some(step.map(|s| s.error_m) > error || step.is_none())
        };
        let whole = |t: &[u32; 3]| {
            let submesh = |v: u32| mesh.submesh.get(v as usize);
            submesh(t[0]) == submesh(t[1]) && submesh(t[1]) == submesh(t[2])
        };
        let all_alive = |t: &[u32; 3]| t.iter().all(|&v| alive(v) == Some(true));
        // Instances tell both sides of it apart by the error alone.
        let starts = r.step == 0 || sequence.steps.get(r.step - 1).map(|s| s.error_m) < error;
        let reason = if error.is_none() || !starts {
            "triangles are replaced within the steps of one error, or after the last"
        } else if !r.triangles.iter().all(all_alive) {
            "a triangle that replaces others has a vertex that is dead or does not exist"
        } else if !r.triangles.iter().all(whole) {
            "a triangle that replaces others lies in two submeshes"
        } else {
            return Ok(died_at);
        };
        return Err(BakeError::Sequence {
            step: r.step,
            reason,
        });
    }
    Ok(died_at)
}

/// A number per local vertex that is equal for vertices at one position.
fn places(mesh: &Mesh, vertices: &[u32]) -> Vec<u32> {
    let mut seen = std::collections::HashMap::new();
    vertices
        .iter()
        .map(|&v| {
            let next = seen.len() as u32;
            *seen
                .entry(mesh.positions[v as usize].to_array().map(f32::to_bits))
                .or_insert(next)
        })
        .collect()
}

/// Live vertices at an LOD error: those whose collapse error is above it. `collapse` is one submesh's part.
pub fn live_count(collapse: &[CollapseEntry], error: f32) -> u32 {
    collapse.partition_point(|c| c.error > error) as u32
}

/// The ancestor of `vertex` that is alive when `live` vertices are.
pub fn ancestor(collapse: &[CollapseEntry], mut vertex: u32, live: u32) -> u32 {
    while vertex >= live.max(1) {
        vertex = collapse[vertex as usize].parent;
    }
    vertex
}

struct Windows<'a> {
    collapse: &'a [CollapseEntry],
    place: Vec<u32>,
    full: Vec<[u32; 3]>,
    replacement: Option<Replaced>,
}

/// Triangles of a submesh that take the place of all others.
struct Replaced {
    /// Live vertices from which on, downwards, they do.
    live: u32,
    triangles: Vec<[u32; 3]>,
}

impl Windows<'_> {
    fn cut(&self, form: BandForm, bands: &mut Vec<Band>, indices: &mut Vec<u32>) {
        match form {
            BandForm::Collapsed { ratio } => {
                for live in self.live_counts(ratio) {
                    let first_index = indices.len() as u32;
                    let triangles = self.triangles(live);
                    let flat: Vec<u32> = triangles.into_iter().flatten().collect();
                    indices.extend(meshopt::optimize_vertex_cache(&flat, live as usize));
                    bands.push(self.band(first_index, indices.len() as u32 - first_index, live));
                }
            }
            BandForm::SingleWindow => {
                let counts = self.live_counts(std::f32::consts::SQRT_2);
                let replaced = counts.partition_point(|&live| !self.is_replaced(live));
                for counts in [&counts[..replaced], &counts[replaced..]] {
                    let Some(&first) = counts.first() else {
                        continue;
                    };
                    let first_index = indices.len() as u32;
                    let drawn = self.drawn_from(first).iter();
                    let mut dying: Vec<(u32, [u32; 3])> =
                        drawn.map(|&t| (self.dies_at(t), t)).collect();
                    dying.sort_by_key(|&(dies_at, _)| dies_at);
                    indices.extend(dying.iter().flat_map(|&(_, t)| t));
                    for &live in counts {
                        let alive = dying.partition_point(|&(dies_at, _)| dies_at < live) as u32;
                        bands.push(self.band(first_index, 3 * alive, live));
                    }
                }
            }
        }
    }

    fn band(&self, first_index: u32, index_count: u32, live: u32) -> Band {
        let error = self.collapse.get(live as usize).map_or(0.0, |c| c.error);
        Band {
            first_index,
            index_count,
            vertex_count: live,
            error,
        }
    }

    /// Live-vertex counts of the bands, falling. Each lies where the collapse error changes: no instance can have a count
    /// between two vertices of one error.
    fn live_counts(&self, ratio: f32) -> Vec<u32> {
        let n = self.collapse.len() as u32;
        let mut counts = vec![n];
        let mut last = n;
        // Where other triangles take the place of all there is a band, whatever its width.
        let replaced = self.replacement.as_ref().map(|r| r.live);
        let due = |last: u32| replaced.filter(|&r| r < last);
        while last > MIN_BAND_VERTICES || due(last).is_some() {
            let step = step_ratio(ratio, last, n);
            let wanted = ((last as f32 / step).floor() as u32).max(MIN_BAND_VERTICES);
            let narrower = self.at_error_change(wanted);
            let live = match due(last) {
                Some(r) if narrower >= last || self.triangles(last).is_empty() => r,
                Some(r) => narrower.max(r),
                None => narrower,
            };
            if live >= last || live == 0 {
                break;
            }
            counts.push(live);
            if self.triangles(live).is_empty() && due(live).is_none() {
                return counts;
            }
            last = live;
        }
        // Where everything vanishes in the end, a band without triangles says so.
        let roots = live_count(self.collapse, f32::MAX);
        if roots > 0 && roots < last && self.triangles(roots).is_empty() {
            let (mut gone, mut drawn) = (roots, last);
            while gone + 1 < drawn {
                let middle = gone.midpoint(drawn);
                if self.triangles(middle).is_empty() {
                    gone = middle
                } else {
                    drawn = middle
                }
            }
            let live = self.at_error_change(gone);
            if live < last && live > 0 {
                counts.push(live);
            }
        }
        counts
    }

    /// The greatest reachable count that is not above `wanted`.
    fn at_error_change(&self, wanted: u32) -> u32 {
        match self.collapse.get(wanted as usize) {
            Some(c) => self.collapse.partition_point(|x| x.error > c.error) as u32,
            None => self.collapse.len() as u32,
        }
    }

    fn is_replaced(&self, live: u32) -> bool {
        self.replacement.as_ref().is_some_and(|r| live <= r.live)
    }

    /// The triangles that the level of `live` vertices is what is left of.
    fn drawn_from(&self, live: u32) -> &[[u32; 3]] {
        match &self.replacement {
            Some(r) if live <= r.live => &r.triangles,
            _ => &self.full,
        }
    }

    /// Triangles alive at `live` vertices with their corners at living ancestors, in source order.
    fn triangles(&self, live: u32) -> Vec<[u32; 3]> {
        let mut seen = HashSet::new();
        let mut out = Vec::new();
        for t in self.drawn_from(live) {
            let c = t.map(|v| ancestor(self.collapse, v, live));
            if !self.degenerate(c) && seen.insert(rotated(c)) {
                out.push(c);
            }
        }
        out
    }

    /// Two corners are one vertex or stand at one position.
    fn degenerate(&self, c: [u32; 3]) -> bool {
        let p = c.map(|v| self.place[v as usize]);
        p[0] == p[1] || p[1] == p[2] || p[2] == p[0]
    }

    /// The greatest live-vertex count at which the triangle is degenerate (0 for never); it stays so below.
    fn dies_at(&self, triangle: [u32; 3]) -> u32 {
        let mut corners = triangle;
        loop {
            if self.degenerate(corners) {
                return self.collapse.len() as u32;
            }
            // The youngest corner moves next; from then on that many vertices are alive.
            let Some(i) = (0..3).max_by_key(|&i| corners[i]) else {
                return 0;
            };
            let parent = self.collapse[corners[i] as usize].parent;
            if parent == corners[i] {
                return 0;
            }
            let live = corners[i];
            corners[i] = parent;
            if self.degenerate(corners) {
                return live;
            }
        }
    }
}

/// The same triangle, its smallest corner first.
fn rotated(c: [u32; 3]) -> [u32; 3] {
    if c[0] <= c[1] && c[0] <= c[2] {
        c
    } else if c[1] <= c[2] {
        [c[1], c[2], c[0]]
    } else {
        [c[2], c[0], c[1]]
    }
}

/// The band that instances with `live` live vertices draw: the tightest that holds them. `bands` are one submesh's; none where
/// there are no bands.
pub fn band_at(bands: &[Band], live: u32) -> Option<&Band> {
    let tightest = bands.iter().rev().find(|b| b.vertex_count >= live);
    tightest.or(bands.first())
}

/// Triangles of one submesh at an LOD error, as the vertex shader would show them.
///
/// `collapse` is the submesh's part; `window` the indices of the band that is drawn at that error, see [`band_at`], or of any
/// finer one on the same side of a replacement; `same_place` says which vertices have equal positions.
pub fn triangles_at(
    collapse: &[CollapseEntry],
    window: &[u32],
    same_place: impl Fn(u32, u32) -> bool,
    error: f32,
) -> Vec<[u32; 3]> {
    let live = live_count(collapse, error);
    let mut seen = HashSet::new();
    window
        .chunks_exact(3)
        .map(|t| [t[0], t[1], t[2]].map(|v| ancestor(collapse, v, live)))
        .filter(|c| {
            !(same_place(c[0], c[1]) || same_place(c[1], c[2]) || same_place(c[2], c[0]))
                && seen.insert(rotated(*c))
        })
        .collect()
}
