//! The character as limbs: its surface in pieces, each along a line of nodes, by the skeleton.

use glam::{Vec3, Vec4};

use crate::mesh::Mesh;

use super::looks::Looks;
use super::rig::Rig;

/// Samples of a face: barycentric coordinates.
const ON_FACE: [[f32; 3]; 4] = [
    [1.0 / 3.0; 3],
    [0.7, 0.15, 0.15],
    [0.15, 0.7, 0.15],
    [0.15, 0.15, 0.7],
];
/// Shares of the samples along a piece that lie before its first and last node.
const ENDS: [f32; 2] = [0.02, 0.98];
/// A single group belongs to the trunk unless it reaches this many times as far.
const STANDS_OUT: f32 = 1.25;
/// Length of a limb's first part against the mean of the others below which that is a shoulder or a hip.
const SHORT: f32 = 0.45;
/// Cosine of the angle between trunk and limb within which the trunk's clothes may hang about it.
const HANGS: f32 = 0.8;
/// Share of a limb's surface below which the trunk's clothes on it belong to the trunk, and share of the trunk's from which
/// clothes are its own.
const HEM_SHARE: f32 = 0.6;
const CLOTHES_SHARE: f32 = 0.2;
/// Places along a piece where its colours are tried to part.
const PARTINGS: usize = 24;
/// Share of the variance of colours that may be left where they part, and least deviation for which they do.
const PARTED: f32 = 0.6;
const LEAST_CONTRAST: f32 = 0.1;
/// Distance between nodes, in parts of the way to the next, below which they are one.
const NODE_GAP: f32 = 0.2;
/// Most samples of a piece.
const SAMPLES_MAX: usize = 800;
/// Fewest groups of joints that say what limbs are.
const LEAST_GROUPS: usize = 3;
/// Least share of the surface of a piece.
const LEAST_SHARE: f32 = 0.012;

/// A place on the full surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct LimbSample {
    pub at: Vec3,
    pub normal: Vec3,
    /// Area as far as it is seen.
    pub weight: f32,
    pub color: Vec4,
    pub part: u8,
    /// A vertex whose skinning is that of the place.
    pub vertex: u32,
    group: usize,
}

/// A part of the character along a line.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// Bind space; at least two.
    pub nodes: Vec<Vec3>,
    pub samples: Vec<LimbSample>,
    /// Place of each sample along the nodes: 1.5 is halfway from the second to the third.
    pub along: Vec<f32>,
    pub kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Trunk,
    Head,
    Limb,
}

/// The pieces of `mesh`, the trunk first; none where the rig says nothing. `seen` is the share of each triangle that is seen.
pub(super) fn pieces(mesh: &Mesh, looks: &Looks, rig: &Rig, seen: &[f32]) -> Vec<Piece> {
    let samples = samples(mesh, looks, rig, seen);
    if rig.groups.len() < LEAST_GROUPS || samples.is_empty() {
        return Vec::new();
    }
    let body = Body::new(&samples, rig);
    let mut trunk = body.samples_of(|g| body.in_trunk[g]);
    if trunk.is_empty() {
        return Vec::new();
    }
    let (limbs, heads) = body.limbs(rig);
    let clothes = Clothes {
        axis: long_axis(&trunk),
        parts: main_parts(&trunk),
    };
    let least = LEAST_SHARE * weight(&samples);
    let mut out = Vec::new();
    for limb in limbs {
        let head = heads.iter().copied();
        let head = head.filter(|&h| body.parents[h] == limb.last().copied());
        let end = head.map(|h| rig.groups[h].origin).next();
        out.extend(body.limb(rig, &limb, end, &clothes, least, &mut trunk));
    }
    for head in heads {
        let samples = body.samples_of(|g| g == head);
        let axis = mean(&samples) - rig.groups[head].origin;
        out.extend(Piece::straight(axis, samples, Kind::Head));
    }
    let trunk = Piece::straight(long_axis(&trunk), trunk, Kind::Trunk);
    out.splice(0..0, trunk);
    out
}

/// What the trunk is like, for what may belong to it elsewhere.
struct Clothes {
    axis: Vec3,
    /// Body parts that much of it shows.
    parts: Vec<u8>,
}

/// The groups of a rig as a body.
struct Body {
    parents: Vec<Option<usize>>,
    children: Vec<Vec<usize>>,
    /// All that branches, but heads, and what lies between.
    in_trunk: Vec<bool>,
    /// Samples of each group.
    own: Vec<Vec<LimbSample>>,
}

impl Body {
    fn new(samples: &[LimbSample], rig: &Rig) -> Self {
        let count = rig.groups.len();
        let parents = parents(samples, rig);
        let mut children = vec![Vec::new(); count];
        for (g, parent) in parents.iter().enumerate() {
            if let Some(p) = parent {
                children[*p].push(g);
            }
        }
        let mut own = vec![Vec::new(); count];
        for s in samples {
            own[s.group].push(*s);
        }
        let mut in_trunk = vec![false; count];
        for g in (0..count).filter(|&g| children[g].len() > 1 && !rig.groups[g].is_head) {
            for above in std::iter::successors(Some(g), |&g| parents[g]).take(count) {
                in_trunk[above] = true;
            }
        }
        Self {
            parents,
            children,
            in_trunk,
            own,
        }
    }

    fn samples_of(&self, of: impl Fn(usize) -> bool) -> Vec<LimbSample> {
        let groups = (0..self.own.len()).filter(|&g| of(g));
        groups.flat_map(|g| self.own[g].iter().copied()).collect()
    }

    /// The chains of groups that hang in the trunk, and the heads that they or the trunk end in.
    fn limbs(&self, rig: &Rig) -> (Vec<Vec<usize>>, Vec<usize>) {
        let (mut limbs, mut heads) = (Vec::new(), Vec::new());
        for g in 0..self.parents.len() {
            if self.in_trunk[g] || !self.parents[g].is_some_and(|p| self.in_trunk[p]) {
                continue;
            }
            // Nothing branches from here on but heads.
            let (mut limb, mut at) = (Vec::new(), Some(g));
            while let Some(g) = at {
                if rig.groups[g].is_head {
                    heads.push(g);
                    break;
                }
                limb.push(g);
                at = self.children[g].first().copied();
            }
            if !limb.is_empty() {
                limbs.push(limb);
            }
        }
        (limbs, heads)
    }

    /// The piece of a chain of groups that ends at `end`, or where its samples do. What belongs to the trunk, perhaps all of
    /// it, goes there.
    fn limb(
        &self,
        rig: &Rig,
        limb: &[usize],
        end: Option<Vec3>,
        clothes: &Clothes,
        least: f32,
        trunk: &mut Vec<LimbSample>,
    ) -> Option<Piece> {
        let mut mine = self.samples_of(|g| limb.contains(&g));
        let mut nodes: Vec<Vec3> = limb.iter().map(|&g| rig.groups[g].origin).collect();
        let along = nodes.get(1).map_or(Vec3::ZERO, |&n| n - nodes[0]);
        if along.normalize_or_zero().dot(clothes.axis).abs() > HANGS {
            // Skirts and hems hang about the legs that move them.
            let share = HEM_SHARE * weight(&mine);
            let of = |part: u8| mine.iter().filter(move |s| s.part == part);
            let of = |part: u8| of(part).map(|s| s.weight).sum::<f32>();
            let hems = clothes.parts.iter().copied();
            let hems: Vec<u8> = hems.filter(|&p| of(p) < share).collect();
            trunk.extend(mine.iter().filter(|s| hems.contains(&s.part)));
            mine.retain(|s| !hems.contains(&s.part));
        }
        if weight(&mine) < least || limb.len() == 1 && !stands_out(&mine, trunk) {
            trunk.append(&mut mine);
            return None;
        }
        let last = *nodes.last()?;
        let tip = self.samples_of(|g| limb.last() == Some(&g));
        let tip = if tip.is_empty() { last } else { mean(&tip) };
        nodes.push(end.unwrap_or(last + 2.0 * (tip - last)));
        let lengths: Vec<f32> = nodes.windows(2).map(|n| n[0].distance(n[1])).collect();
        let rest = lengths[1..].iter().sum::<f32>() / (lengths.len() - 1).max(1) as f32;
        if lengths[0] < SHORT * rest {
            trunk.extend(mine.iter().filter(|s| s.group == limb[0]));
            mine.retain(|s| s.group != limb[0]);
            nodes.remove(0);
        }
        Piece::along(nodes, mine, Kind::Limb, end.is_none())
    }
}

impl Piece {
    /// Along `nodes`, whose last is moved to where the samples end.
    fn along(
        mut nodes: Vec<Vec3>,
        samples: Vec<LimbSample>,
        kind: Kind,
        open: bool,
    ) -> Option<Self> {
        nodes.dedup_by(|a, b| a.distance_squared(*b) < 1e-12);
        if nodes.len() < 2 || samples.is_empty() {
            return None;
        }
        let last = nodes.len() - 1;
        let direction = (nodes[last] - nodes[last - 1]).normalize_or_zero();
        if open {
            let reach = samples
                .iter()
                .map(|s| (s.at - nodes[last - 1]).dot(direction));
            let mut reach: Vec<f32> = reach.collect();
            reach.sort_by(f32::total_cmp);
            let end = reach[((reach.len() - 1) as f32 * ENDS[1]) as usize];
            let least = 0.3 * nodes[last].distance(nodes[last - 1]);
            nodes[last] = nodes[last - 1] + direction * end.max(least);
        }
        let step = samples.len().div_ceil(SAMPLES_MAX);
        let samples: Vec<LimbSample> = samples.into_iter().step_by(step).collect();
        let along = samples.iter().map(|s| along(&nodes, s.at)).collect();
        let mut piece = Self {
            nodes,
            samples,
            along,
            kind,
        };
        piece.trim();
        piece.part_colors();
        Some(piece)
    }

    /// Begins where the samples do.
    fn trim(&mut self) {
        let mut order = self.along.clone();
        order.sort_by(f32::total_cmp);
        let start = order[((order.len() - 1) as f32 * ENDS[0]) as usize] - 0.1;
        if start > NODE_GAP {
            let whole = (start as usize).min(self.nodes.len() - 2);
            let at = self.at(start);
            self.nodes.drain(..=whole);
            self.nodes.insert(0, at);
            self.again();
        }
    }

    /// A node where colours part, if they do.
    fn part_colors(&mut self) {
        let last = (self.nodes.len() - 1) as f32;
        let spread = |range: [f32; 2]| {
            let (mut sum, mut square) = (Vec4::ZERO, 0.0);
            for (s, &a) in self.samples.iter().zip(&self.along) {
                if a >= range[0] && a < range[1] {
                    sum += s.color.truncate().extend(1.0) * s.weight;
                    square += s.color.truncate().length_squared() * s.weight;
                }
            }
            let left = square - sum.truncate().length_squared() / sum.w.max(f32::MIN_POSITIVE);
            (left.max(0.0), sum.w)
        };
        let (all, weight) = spread([f32::MIN, f32::MAX]);
        let best = (1..PARTINGS)
            .map(|i| last * i as f32 / PARTINGS as f32)
            .map(|t| (spread([f32::MIN, t]).0 + spread([t, f32::MAX]).0, t))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((left, t)) = best else { return };
        if left > PARTED * all || (all / weight.max(f32::MIN_POSITIVE)).sqrt() < LEAST_CONTRAST {
            return;
        }
        let at = self.at(t);
        let nearest = t.round();
        let ends = nearest == 0.0 || nearest == last;
        if (t - nearest).abs() > NODE_GAP {
            self.nodes.insert(t as usize + 1, at);
        } else if !ends {
            self.nodes[nearest as usize] = at;
        }
        self.again();
    }

    /// The place at `t` along the nodes.
    fn at(&self, t: f32) -> Vec3 {
        let whole = (t as usize).min(self.nodes.len() - 2);
        self.nodes[whole].lerp(self.nodes[whole + 1], t - whole as f32)
    }

    fn again(&mut self) {
        self.along = self
            .samples
            .iter()
            .map(|s| along(&self.nodes, s.at))
            .collect();
    }

    /// Three nodes along `axis`, from end to end.
    fn straight(axis: Vec3, samples: Vec<LimbSample>, kind: Kind) -> Option<Self> {
        let axis = axis.normalize_or(Vec3::Y);
        let center = mean(&samples);
        let mut reach: Vec<f32> = samples.iter().map(|s| (s.at - center).dot(axis)).collect();
        reach.sort_by(f32::total_cmp);
        let at = |share: f32| {
            center
                + axis
                    * *reach
                        .get(((reach.len() - 1) as f32 * share) as usize)
                        .unwrap_or(&0.0)
        };
        let (from, to) = (at(ENDS[0]), at(ENDS[1]));
        Self::along(vec![from, 0.5 * (from + to), to], samples, kind, false)
    }

    /// Direction at a node.
    pub fn direction(&self, node: usize) -> Vec3 {
        let n = &self.nodes;
        let from = n[node.saturating_sub(1)];
        let to = n[(node + 1).min(n.len() - 1)];
        (to - from).normalize_or(Vec3::Y)
    }
}

/// Place along a line of nodes that is nearest to `p`.
fn along(nodes: &[Vec3], p: Vec3) -> f32 {
    let mut best = (f32::MAX, 0.0);
    for (i, n) in nodes.windows(2).enumerate() {
        let d = n[1] - n[0];
        let t = ((p - n[0]).dot(d) / d.length_squared().max(1e-20)).clamp(0.0, 1.0);
        let gap = p.distance_squared(n[0] + d * t);
        if gap < best.0 {
            best = (gap, i as f32 + t);
        }
    }
    best.1
}

/// Body parts that make up much of the samples.
fn main_parts(samples: &[LimbSample]) -> Vec<u8> {
    let mut weights = [0.0f32; 256];
    samples
        .iter()
        .for_each(|s| weights[s.part as usize] += s.weight);
    let least = CLOTHES_SHARE * weights.iter().sum::<f32>();
    (0..=u8::MAX)
        .filter(|&p| weights[p as usize] > least)
        .collect()
}

fn weight(samples: &[LimbSample]) -> f32 {
    samples.iter().map(|s| s.weight).sum()
}

/// Where samples are on average.
pub(super) fn mean(samples: &[LimbSample]) -> Vec3 {
    let mut sum = Vec4::ZERO;
    for s in samples {
        sum += s.at.extend(1.0) * s.weight.max(1e-12);
    }
    sum.truncate() / sum.w.max(f32::MIN_POSITIVE)
}

/// Whether samples reach farther out than the trunk's.
fn stands_out(mine: &[LimbSample], trunk: &[LimbSample]) -> bool {
    if trunk.is_empty() {
        return true;
    }
    let center = mean(trunk);
    let way = (mean(mine) - center).normalize_or_zero();
    let reach = |s: &[LimbSample]| {
        let mut r: Vec<f32> = s.iter().map(|s| (s.at - center).dot(way)).collect();
        r.sort_by(f32::total_cmp);
        r[((r.len() - 1) as f32 * 0.9) as usize]
    };
    reach(mine) > STANDS_OUT * reach(trunk)
}

/// The direction in which samples lie farthest apart.
fn long_axis(samples: &[LimbSample]) -> Vec3 {
    let center = mean(samples);
    let mut m = glam::Mat3::ZERO;
    for s in samples {
        let d = s.at - center;
        m += glam::Mat3::from_cols(d * d.x, d * d.y, d * d.z) * s.weight;
    }
    let mut v = Vec3::new(0.3, 0.8, 0.52);
    for _ in 0..40 {
        v = (m * v).normalize_or(Vec3::Y);
    }
    v
}

/// What each group hangs in; those that hang in none (feet that only controls move) in the one that they are nearest to.
fn parents(samples: &[LimbSample], rig: &Rig) -> Vec<Option<usize>> {
    let count = rig.groups.len();
    let mut parents: Vec<Option<usize>> = rig.groups.iter().map(|g| g.parent).collect();
    let weight_of = |g: usize| {
        samples
            .iter()
            .filter(|s| s.group == g)
            .map(|s| s.weight)
            .sum::<f32>()
    };
    let roots: Vec<usize> = (0..count).filter(|&g| parents[g].is_none()).collect();
    let tree = |root: usize, parents: &[Option<usize>]| -> Vec<usize> {
        let under = |&g: &usize| {
            std::iter::successors(Some(g), |&g| parents[g])
                .take(count)
                .any(|a| a == root)
        };
        (0..count).filter(under).collect()
    };
    let size = |root: usize| tree(root, &parents).into_iter().map(weight_of).sum::<f32>();
    let Some(&main) = roots.iter().max_by(|&&a, &&b| size(a).total_cmp(&size(b))) else {
        return parents;
    };
    for root in roots.into_iter().filter(|&r| r != main) {
        let mine = tree(root, &parents);
        let of = |inside: bool| {
            samples
                .iter()
                .filter(move |s| mine.contains(&s.group) == inside)
        };
        // From what of the root's own is nearest to another.
        let mut best = (f32::MAX, None);
        let origin = rig.groups[root].origin;
        let others: Vec<&LimbSample> = of.clone()(false).collect();
        for s in of(true).filter(|s| s.group == root).step_by(7) {
            for o in others.iter().step_by(3) {
                let gap = s.at.distance_squared(o.at) + 0.05 * o.at.distance_squared(origin);
                if gap < best.0 {
                    best = (gap, Some(o.group));
                }
            }
        }
        parents[root] = best.1.or(Some(main));
    }
    parents
}

fn samples(mesh: &Mesh, looks: &Looks, rig: &Rig, seen: &[f32]) -> Vec<LimbSample> {
    let mut out = Vec::with_capacity(mesh.triangles.len() * ON_FACE.len());
    for (t, &seen) in mesh.triangles.iter().zip(seen) {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let area = 0.5 * (b - a).cross(c - a).length();
        let weight = area * seen / ON_FACE.len() as f32;
        if weight.is_nan() || weight <= 0.0 {
            continue;
        }
        for shares in ON_FACE {
            let nearest = (0..3)
                .max_by(|&i, &j| shares[i].total_cmp(&shares[j]))
                .unwrap_or(0);
            let vertex = t[nearest];
            let look = looks.at(mesh, *t, shares);
            let joint = mesh.joints[vertex as usize][0] as usize;
            out.push(LimbSample {
                at: a * shares[0] + b * shares[1] + c * shares[2],
                normal: look.normal,
                weight,
                color: look.color,
                part: mesh.body_parts[vertex as usize],
                vertex,
                group: rig.of_joint.get(joint).copied().unwrap_or(0),
            });
        }
    }
    out
}
