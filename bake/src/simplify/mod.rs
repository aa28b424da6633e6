//! Simplifies a whole character: one queue of half-edge collapses over all submeshes.
//!
//! A *point* is a position with its skinning; its *wedges* are the vertices there (Hoppe 1998). A collapse moves a point
//! with all its wedges onto another, so that submeshes never crack against each other; a wedge may also move onto its
//! twin at the same point, which gives up a seam; and points of different pieces may contract across small gaps, so that
//! every character has levels down to a few triangles.

mod attributes;
mod extract;
mod lanes;
mod links;
mod poses;
mod quadric;
mod samples;
mod surface;

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::mesh::{Collapse, CollapseSequence, Mesh};

use attributes::WedgeMove;
use quadric::Quadrics;
use samples::Samples;
use surface::{Surface, cross, dot, sub};

pub use extract::triangles_at;
pub use poses::{Pose, PoseSet};

/// Weight of the quadrics' cost beside the measured one: it sees what samples miss, and tells equals apart.
const QUADRIC_WEIGHT: f64 = 0.03;
/// Targets that a point tries by measuring, the best by quadrics.
const TRIED: usize = 3;
/// Weight of a change of looks against a deviation of the same length.
const LOOKS_WEIGHT: f64 = 0.1;
/// Weight of a face that turns over, against moving it by its own size.
const FLIP_WEIGHT: f64 = 1.0;
/// Cosine of the turn from which a face counts as turned over.
const FLIP_COSINE: f32 = 0.25;

/// The whole sequence of half-edge collapses of `mesh`, errors measured in `poses`.
///
/// Guarantees: deterministic; every vertex but one root per submesh is a source exactly once, and its target is of the same
/// submesh and alive; `error_m` never falls; the steps of one point stand together and have the same error.
pub fn simplify(mesh: &Mesh, poses: &PoseSet) -> CollapseSequence {
    let mut surface = Surface::new(mesh, poses);
    links::link_pieces(&mut surface);
    let quadrics = Quadrics::new(&surface);
    let samples = Samples::new(&surface);
    let point_count = surface.faces_of.len();
    let mut simplifier = Simplifier {
        stamps: vec![0; point_count],
        heap: BinaryHeap::new(),
        collapses: vec![None; point_count],
        cursor: vec![0; mesh.submeshes.len()],
        surface,
        quadrics,
        samples,
        dirty: vec![false; point_count],
        error: 0.0,
        moves: Vec::new(),
        targets: Vec::new(),
    };
    for point in 0..simplifier.stamps.len() as u32 {
        simplifier.propose(point);
    }
    while let Some(best) = simplifier.heap.pop() {
        if best.stamp != simplifier.stamps[best.point as usize] {
            continue;
        }
        match best.action {
            Action::Collapse { .. } if simplifier.dirty[best.point as usize] => {
                simplifier.propose(best.point);
            }
            // Faces may have grown since: then it costs more by now.
            Action::Twin { .. } if simplifier.twin_costs_more(&best) => {
                simplifier.enqueue(best.point);
            }
            _ => simplifier.perform(best),
        }
    }
    simplifier.finish()
}

/// What can be done to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Action {
    /// Move the point with all its wedges onto another.
    Collapse { target: u32 },
    /// Move one of its wedges onto another of its wedges.
    Twin { from: u32, to: u32 },
}

/// The best action of a point at the time of its stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Proposal {
    /// Area times squared length.
    cost: f64,
    /// Length.
    error: f64,
    point: u32,
    stamp: u32,
    action: Action,
}

impl Eq for Proposal {}

impl Ord for Proposal {
    /// The cheapest is the greatest: the heap's top. Equal costs go by point, so that runs agree.
    fn cmp(&self, other: &Self) -> Ordering {
        let cost = other.cost.total_cmp(&self.cost);
        cost.then(other.point.cmp(&self.point))
            .then(self.stamp.cmp(&other.stamp))
    }
}

impl PartialOrd for Proposal {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

struct Simplifier<'a> {
    surface: Surface<'a>,
    quadrics: Quadrics,
    samples: Samples,
    /// Per point: its proposal is from before a change next to it, and is looked at again before it is carried out.
    dirty: Vec<bool>,
    heap: BinaryHeap<Proposal>,
    /// Per point: its best collapse.
    collapses: Vec<Option<(f64, f64, Action)>>,
    /// Per point: proposals with another stamp are out of date.
    stamps: Vec<u32>,
    /// Per submesh: no face before this one is alive and of the submesh.
    cursor: Vec<usize>,
    /// Greatest error so far.
    error: f32,
    moves: Vec<WedgeMove>,
    targets: Vec<u32>,
}

impl Simplifier<'_> {
    /// Looks for the best collapse of `point` and puts its best action into the queue.
    fn propose(&mut self, point: u32) {
        self.dirty[point as usize] = false;
        let mut targets = std::mem::take(&mut self.targets);
        self.surface.neighbors(point, &mut targets);
        let mut best: Option<(f64, f64, Action)> = None;
        let mut choices: Vec<(f64, f64, f64, u32)> = Vec::new();
        for &target in &targets {
            if let Some((cost, other, error)) = self.collapse_cost(point, target) {
                choices.push((cost, other, error, target));
            }
        }
        choices.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.3.cmp(&b.3)));
        for &(_, other, error, target) in choices.iter().take(TRIED) {
            let change = self.samples.try_collapse(&self.surface, point, target);
            let cost = other + change.cost;
            if best.is_none_or(|b| cost < b.0) {
                best = Some((cost, error, Action::Collapse { target }));
            }
        }
        self.targets = targets;
        self.collapses[point as usize] = best;
        self.enqueue(point);
    }

    /// Puts the best action of `point` into the queue; the best collapse is known.
    fn enqueue(&mut self, point: u32) {
        self.stamps[point as usize] += 1;
        let mut best = self.collapses[point as usize];
        if let Some(twin) = self.best_twin(point)
            && best.is_none_or(|b| twin.0 < b.0)
        {
            best = Some(twin);
        }
        if let Some((cost, error, action)) = best {
            self.heap.push(Proposal {
                cost,
                error,
                point,
                stamp: self.stamps[point as usize],
                action,
            });
        }
    }

    fn twin_costs_more(&self, proposal: &Proposal) -> bool {
        self.best_twin(proposal.point)
            .is_none_or(|twin| twin.0 > proposal.cost * (1.0 + 1e-9))
    }

    /// Cost and error of moving `point` onto `target`; none where it may not.
    fn collapse_cost(&mut self, point: u32, target: u32) -> Option<(f64, f64, f64)> {
        let mut moves = std::mem::take(&mut self.moves);
        let allowed = attributes::wedge_moves(&self.surface, point, target, &mut moves);
        let (mut looks, mut looks_error) = (0.0, 0.0f64);
        for m in &moves {
            let length = (m.contrast * m.area.sqrt()) as f64;
            looks += m.area as f64 * length * length;
            looks_error = looks_error.max(length);
        }
        self.moves = moves;
        if !allowed {
            return None;
        }
        let (mean, worst) = self.quadrics.error(&self.surface, point, target);
        let flips = self.flips(point, target);
        let area = self.quadrics.areas[point as usize].max(f64::MIN_POSITIVE);
        let error = (worst / area + LOOKS_WEIGHT * looks_error * looks_error).sqrt();
        let other = LOOKS_WEIGHT * looks + FLIP_WEIGHT * flips;
        Some((mean + other, other + QUADRIC_WEIGHT * mean, error))
    }

    /// Area squared of the faces that turn over if `point` moves onto `target`, by the share of poses in which they do.
    fn flips(&self, point: u32, target: u32) -> f64 {
        let s = &self.surface;
        let mut sum = 0.0;
        for &f in &s.faces_of[point as usize] {
            let face = &s.faces[f as usize];
            if face.has(target) {
                continue;
            }
            let corner = face.points.iter().position(|&p| p == point).unwrap_or(0);
            let (c, d) = (face.points[(corner + 1) % 3], face.points[(corner + 2) % 3]);
            for k in 0..s.pose_count {
                let [a, b, c, d] = [point, target, c, d].map(|p| s.at(p).map(|x| x[k]));
                let edge = sub(d, c);
                let old = cross(edge, sub(a, c));
                let new = cross(edge, sub(b, c));
                let (cos, new2) = (dot(old, new), dot(new, new));
                if cos <= 0.0 || cos * cos < FLIP_COSINE * FLIP_COSINE * dot(old, old) * new2 {
                    sum += (0.25 * s.pose_weights[k] * new2) as f64;
                }
            }
        }
        sum
    }

    /// The cheapest way to give up a seam at `point`.
    fn best_twin(&self, point: u32) -> Option<(f64, f64, Action)> {
        let s = &self.surface;
        let wedges = &s.wedges_of[point as usize];
        let mut best: Option<(f64, f64, Action)> = None;
        for &from in wedges {
            let faces = s.faces_of[point as usize].iter();
            let area: f32 = faces
                .filter(|&&f| s.faces[f as usize].wedge_at(point) == from)
                .map(|&f| s.areas[f as usize])
                .sum();
            for &to in wedges {
                if to == from || s.mesh.submesh[to as usize] != s.mesh.submesh[from as usize] {
                    continue;
                }
                let length = (attributes::contrast(s, from, to, area, false) * area.sqrt()) as f64;
                let cost = LOOKS_WEIGHT * area as f64 * length * length;
                if best.is_none_or(|b| cost < b.0) {
                    let error = LOOKS_WEIGHT.sqrt() * length;
                    best = Some((cost, error, Action::Twin { from, to }));
                }
            }
        }
        best
    }

    fn perform(&mut self, proposal: Proposal) {
        // Errors of different points differ, if only by the last bit: any number of points can then be asked for.
        let error = (proposal.error * self.surface.unit as f64) as f32;
        self.error = if error > self.error || self.error == 0.0 {
            error.max(self.error)
        } else {
            self.error.next_up()
        };
        match proposal.action {
            Action::Twin { from, to } => {
                self.retarget(proposal.point, from, to);
                self.step(from, to);
                self.enqueue(proposal.point);
            }
            Action::Collapse { target } => self.collapse(proposal.point, target),
        }
    }

    /// Moves `point` onto `target` and proposes anew for all points that see it.
    fn collapse(&mut self, point: u32, target: u32) {
        let mut moves = std::mem::take(&mut self.moves);
        attributes::wedge_moves(&self.surface, point, target, &mut moves);
        for m in &moves {
            if let Some(to) = m.to {
                self.retarget(point, m.from, to);
            }
        }
        self.samples.try_collapse(&self.surface, point, target);
        self.samples.commit(&self.surface, point, target);
        let mut touched = Vec::new();
        let s = &mut self.surface;
        for f in std::mem::take(&mut s.faces_of[point as usize]) {
            let face = &mut s.faces[f as usize];
            if face.has(target) {
                face.alive = false;
                for p in face.points {
                    if p != point {
                        s.faces_of[p as usize].retain(|&x| x != f);
                        touched.push(p);
                    }
                }
            } else {
                for p in &mut face.points {
                    if *p == point {
                        *p = target;
                    }
                }
                let points = face.points;
                s.faces_of[target as usize].push(f);
                s.areas[f as usize] = s.face_area(points);
            }
        }
        for link in std::mem::take(&mut s.links[point as usize]) {
            let list = &mut s.links[link as usize];
            list.retain(|&p| p != point);
            if link != target {
                list.push(target);
                s.links[target as usize].push(link);
            }
        }
        self.quadrics.add(target, point);
        for m in &moves {
            if let Some(to) = m.to.or_else(|| self.any_wedge(target, m.from)) {
                self.step(m.from, to);
            }
        }
        self.moves = moves;
        self.surface.wedges_of[point as usize].clear();
        self.stamps[point as usize] += 1;

        touched.sort_unstable();
        touched.dedup();
        for &p in &touched {
            self.drop_bare_wedges(p, target);
        }
        self.surface.neighbors(target, &mut touched);
        for p in touched {
            self.dirty[p as usize] = true;
        }
        self.propose(target);
    }

    /// Gives the corners that `from` has at `point` to `to`.
    fn retarget(&mut self, point: u32, from: u32, to: u32) {
        let s = &mut self.surface;
        for &f in &s.faces_of[point as usize] {
            for w in &mut s.faces[f as usize].wedges {
                if *w == from {
                    *w = to;
                }
            }
        }
    }

    /// Writes down that `from` dies.
    fn step(&mut self, from: u32, to: u32) {
        let s = &mut self.surface;
        s.sequence.steps.push(Collapse {
            vertex: from,
            target: to,
            error_m: self.error,
        });
        let point = s.point_of_wedge[from as usize];
        s.wedges_of[point as usize].retain(|&w| w != from);
    }

    /// Wedges of `point` without a face die at once: nobody sees it. So does the point where that is all of them.
    fn drop_bare_wedges(&mut self, point: u32, neighbor: u32) {
        for wedge in self.surface.wedges_of[point as usize].clone() {
            let s = &self.surface;
            let mut faces = s.faces_of[point as usize].iter();
            if faces.any(|&f| s.faces[f as usize].wedges.contains(&wedge)) {
                continue;
            }
            let to = self.any_wedge(point, wedge);
            if let Some(to) = to.or_else(|| self.any_wedge(neighbor, wedge)) {
                self.step(wedge, to);
            }
        }
        let s = &mut self.surface;
        if s.faces_of[point as usize].is_empty() {
            for link in std::mem::take(&mut s.links[point as usize]) {
                s.links[link as usize].retain(|&p| p != point);
            }
            self.stamps[point as usize] += 1;
        }
    }

    /// A wedge that `from`, which has no face, can die onto: at `point` where that has one with faces, else anywhere in the
    /// submesh; none where the submesh has no face left.
    fn any_wedge(&mut self, point: u32, from: u32) -> Option<u32> {
        let s = &self.surface;
        let submesh = s.mesh.submesh[from as usize];
        let fits = |w: u32| w != from && s.mesh.submesh[w as usize] == submesh;
        let near = s.faces_of[point as usize].iter();
        if let Some(w) = near
            .map(|&f| s.faces[f as usize].wedge_at(point))
            .filter(|&w| fits(w))
            .min()
        {
            return Some(w);
        }
        let cursor = &mut self.cursor[submesh as usize];
        while let Some(face) = s.faces.get(*cursor) {
            if face.alive && s.mesh.submesh[face.wedges[0] as usize] == submesh {
                return face.wedges.into_iter().find(|&w| fits(w));
            }
            *cursor += 1;
        }
        None
    }

    /// Ends the sequence: what is still alive in a submesh dies onto its root.
    fn finish(mut self) -> CollapseSequence {
        let vertex_count = self.surface.mesh.vertex_count();
        let mut dead = vec![false; vertex_count];
        for step in &self.surface.sequence.steps {
            dead[step.vertex as usize] = true;
        }
        let mut roots = vec![None; self.surface.mesh.submeshes.len()];
        for v in 0..vertex_count as u32 {
            if dead[v as usize] {
                continue;
            }
            let submesh = self.surface.mesh.submesh[v as usize] as usize;
            match roots[submesh] {
                None => roots[submesh] = Some(v),
                Some(root) => self.step(v, root),
            }
        }
        self.surface.sequence
    }
}
