//! Simplifies a whole character: one queue of half-edge collapses over all submeshes.
//!
//! A *point* is a position with its skinning; its *wedges* are the vertices there (Hoppe 1998). A collapse moves a point
//! with all its wedges onto another, so that submeshes never crack against each other; a wedge may also move onto its
//! twin at the same point, which gives up a seam; and points of different pieces may contract across small gaps, so that
//! every character has levels down to a few triangles. Among few points, the one that stays is then fitted to what it
//! stands for, vertices have colours in place of textures, and pictures of the character say what to collapse.

mod attributes;
mod coarse;
mod extract;
mod lanes;
mod limbs;
mod links;
mod looks;
mod pictures;
mod poses;
mod quadric;
mod rebuild;
mod refit;
mod rig;
mod samples;
mod shapes;
mod surface;
mod textures;
mod visibility;

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::character::Image;
use crate::mesh::{Collapse, CollapseSequence, Mesh};

use attributes::WedgeMove;
use coarse::Coarse;
use lanes::{Lanes, Vec3Lanes, read};
use looks::Looks;
use pictures::Pictures;
use quadric::Quadrics;
use samples::Samples;
use surface::Surface;

pub use extract::triangles_at;
pub use poses::{Pose, PoseSet};
pub use rig::Rig;

/// Weight of the quadrics' cost beside the measured one: it sees what samples miss, and tells equals apart.
const QUADRIC_WEIGHT: f64 = 0.03;
/// Targets that a point tries by measuring, the best by quadrics.
const TRIED: usize = 3;
/// Growth of what looks are worth from which a proposal is weighed again.
const LOOKS_DRIFT: f64 = 1.25;
/// Weight of a face that turns over, against moving it by its own size.
const FLIP_WEIGHT: f64 = 1.0;
/// What a corner of another look does to the faces around it: the mean square of a barycentric coordinate.
const INTERPOLATED_SHARE: f32 = 1.0 / 6.0;
/// Error where nothing is left, as a share of the diagonal.
const GONE_ERROR: f64 = 0.5;
/// Error of a level over the geometric mean of its root mean square deviation and the character's diagonal.
///
/// A silhouette of length L that is off by d shows L * d of wrong colour, so the pixel in which it may hide has a side that
/// grows with sqrt(L * d). The factor is set so that a level drawn where its error is a pixel adds less than a tenth to the
/// mean FLIP error that the full mesh has from aliasing, near and far alike.
const ERROR_FACTOR: f64 = 0.4;
/// Weight of a change of volume, against moving the faces by as much.
const VOLUME_WEIGHT: f64 = 3.0;
/// Cosine of the turn from which a face counts as turned over.
const FLIP_COSINE: f32 = 0.25;

/// The whole sequence of half-edge collapses of `mesh`, errors measured in `poses`. `images` are the texture's layers, which
/// say what a shift of texture coordinates looks like; a layer without an image counts as white.
///
/// `mesh` gains the vertices that coarse levels use in place of the full mesh's own; its triangles stay as they are.
///
/// Guarantees: deterministic; every vertex but one root per submesh is a source exactly once, and its target is of the same
/// submesh and alive; `error_m` never falls; the steps of one point stand together and have the same error.
pub fn simplify(mesh: &mut Mesh, poses: &PoseSet, images: &[&Image]) -> CollapseSequence {
    let mut surface = Surface::new(mesh, poses);
    links::link_pieces(&mut surface);
    let quadrics = Quadrics::new(&surface);
    let samples = Samples::new(&surface, Looks::new(images));
    let point_count = surface.faces_of.len();
    let mut simplifier = Simplifier {
        stamps: vec![0; point_count],
        heap: BinaryHeap::new(),
        collapses: vec![None; point_count],
        cursor: vec![0; mesh.submeshes.len()],
        living_points: point_count,
        textures_tried: usize::MAX,
        coarse: Coarse {
            pictures: Pictures::new(&surface, samples.looks()),
            faces: Vec::new(),
            swept: None,
            error_factor: 0.0,
            settled: false,
            rebuilt: false,
            levels: Vec::new(),
        },
        surface,
        quadrics,
        samples,
        dirty: vec![false; point_count],
        weighed: vec![0.0; point_count],
        error: 0.0,
        moves: Vec::new(),
        targets: Vec::new(),
        choices: Vec::new(),
    };
    for point in 0..simplifier.stamps.len() as u32 {
        simplifier.propose(point);
    }
    while !simplifier.coarse.settled && simplifier.perform_next() {}
    if let Some(rebuilt) = simplifier.rebuilt(&poses.rig) {
        simplifier = rebuilt;
    }
    while simplifier.perform_next() {}
    simplifier.finish(mesh)
}

/// What can be done to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Action {
    /// Move the point with all its wedges onto another.
    Collapse { target: u32 },
    /// Move one of its wedges onto another of its wedges.
    Twin { from: u32, to: u32 },
}

/// A target that a point may collapse onto.
#[derive(Debug, Clone, Copy)]
struct Choice {
    /// Cost as quadrics and the wedges' looks have it: says which targets are worth measuring.
    estimate: f64,
    /// Cost beside the measured one.
    unseen: f64,
    target: u32,
}

/// The best action of a point at the time of its stamp.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Proposal {
    /// Area times squared length.
    cost: f64,
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

#[derive(Clone)]
struct Simplifier<'a> {
    surface: Surface<'a>,
    quadrics: Quadrics,
    samples: Samples,
    /// Per point: its proposal is from before a change next to it, and is looked at again before it is carried out.
    dirty: Vec<bool>,
    /// Per point: what looks were worth at that time.
    weighed: Vec<f64>,
    heap: BinaryHeap<Proposal>,
    /// Per point: its best collapse.
    collapses: Vec<Option<(f64, Action)>>,
    /// Per point: proposals with another stamp are out of date.
    stamps: Vec<u32>,
    /// Per submesh: no face before this one is alive and of the submesh.
    cursor: Vec<usize>,
    /// Points that have not collapsed.
    living_points: usize,
    /// Living points when vertex colours were last tried in place of textures; 0 where there is no texture, or no more.
    textures_tried: usize,
    /// What pictures need, which choose at the end.
    coarse: Coarse,
    /// Greatest error so far.
    error: f32,
    moves: Vec<WedgeMove>,
    targets: Vec<u32>,
    choices: Vec<Choice>,
}

impl<'a> Simplifier<'a> {
    /// Carries out the cheapest action, or looks at it again where it is out of date; false where there is none.
    fn perform_next(&mut self) -> bool {
        let Some(best) = self.heap.pop() else {
            return false;
        };
        if best.stamp != self.stamps[best.point as usize] {
            return true;
        }
        match best.action {
            Action::Collapse { .. } if self.out_of_date(best.point) => {
                self.propose(best.point);
            }
            // Faces may have grown since, then it costs more by now; or one of the wedges died with its last face.
            Action::Twin { .. } if self.twin_out_of_date(&best) => {
                self.enqueue(best.point);
            }
            _ => self.perform(best),
        }
        true
    }

    /// Looks for the best collapse of `point` and puts its best action into the queue.
    fn propose(&mut self, point: u32) {
        self.dirty[point as usize] = false;
        self.weighed[point as usize] = self.samples.look_weight();
        if self.pictured() {
            self.collapses[point as usize] = self.best_in_pictures(point);
            self.enqueue(point);
            return;
        }
        let mut targets = std::mem::take(&mut self.targets);
        self.surface.neighbors(point, &mut targets);
        let mut choices = std::mem::take(&mut self.choices);
        choices.clear();
        choices.extend(targets.iter().filter_map(|&t| self.estimate(point, t)));
        choices.sort_by(|a, b| {
            let cost = a.estimate.total_cmp(&b.estimate);
            cost.then(a.target.cmp(&b.target))
        });
        let mut best: Option<(f64, Action)> = None;
        for &Choice { target, unseen, .. } in choices.iter().take(TRIED) {
            let (surface, looks) = (&self.surface, self.samples.looks());
            attributes::wedge_moves(surface, looks, point, target, &mut self.moves);
            let measured = self
                .samples
                .try_collapse(surface, point, target, &self.moves);
            let cost = measured + unseen;
            if best.is_none_or(|b| cost < b.0) {
                best = Some((cost, Action::Collapse { target }));
            }
        }
        self.targets = targets;
        self.choices = choices;
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
        if let Some((cost, action)) = best {
            self.heap.push(Proposal {
                cost,
                point,
                stamp: self.stamps[point as usize],
                action,
            });
        }
    }

    /// Whether the surface around `point` or what looks are worth has changed since its collapse was looked for.
    fn out_of_date(&self, point: u32) -> bool {
        self.dirty[point as usize]
            || self.samples.look_weight() > LOOKS_DRIFT * self.weighed[point as usize]
    }

    fn twin_out_of_date(&mut self, proposal: &Proposal) -> bool {
        self.best_twin(proposal.point).is_none_or(|(cost, action)| {
            action != proposal.action || cost > proposal.cost + 1e-9 * proposal.cost.abs()
        })
    }

    /// What moving `point` onto `target` may cost; none where it may not.
    fn estimate(&mut self, point: u32, target: u32) -> Option<Choice> {
        let (surface, looks) = (&self.surface, self.samples.looks());
        if !attributes::wedge_moves(surface, looks, point, target, &mut self.moves) {
            return None;
        }
        let contrast: f32 = self
            .moves
            .iter()
            .filter_map(|m| {
                let of = |w| looks.of(&surface.mesh, w);
                Some(of(m.from).contrast_squared(&of(m.to?)))
            })
            .sum();
        let faces = surface.faces_of[point as usize].iter();
        let area: f32 = faces.map(|&f| surface.areas[f as usize]).sum();
        let share = INTERPOLATED_SHARE * area / self.moves.len().max(1) as f32;
        let looks = self.samples.look_weight() * (share * contrast) as f64;
        let quadric = self.quadrics.error(surface, point, target);
        let shape = self.shape_cost(point, target);
        Some(Choice {
            estimate: quadric + looks + shape,
            unseen: shape + QUADRIC_WEIGHT * quadric,
            target,
        })
    }

    /// Cost of what distances do not see if `point` moves onto `target`, mean over the poses: area squared of the faces that
    /// turn over, and the volume between old and new faces squared over their area (Lindstrom & Turk 1998), which keeps
    /// limbs thick.
    fn shape_cost(&self, point: u32, target: u32) -> f64 {
        let s = &self.surface;
        let faces = &s.faces_of[point as usize];
        let area: f32 = faces.iter().map(|&f| s.areas[f as usize]).sum();
        let (mut turned, mut swept) = (0.0, 0.0);
        for group in 0..s.group_count {
            let at = |p| Vec3Lanes::read(s.posed_of(p), s.pose_count, group);
            let (from, to) = (at(point), at(target));
            let weights = read(&s.pose_weights, group);
            let mut volume = Lanes::ZERO;
            for &f in faces {
                let face = &s.faces[f as usize];
                if face.has(target) {
                    continue;
                }
                let corner = face.points.iter().position(|&p| p == point).unwrap_or(0);
                let c = at(face.points[(corner + 1) % 3]);
                let edge = at(face.points[(corner + 2) % 3]) - c;
                // Twice the area, as vectors.
                let (old, new) = (edge.cross(from - c), edge.cross(to - c));
                let (turn, size) = (old.dot(new), new.dot(new));
                let least = FLIP_COSINE * FLIP_COSINE * old.dot(old) * size;
                let stays = turn.cmpgt(Lanes::ZERO) & (turn * turn).cmpge(least);
                turned += Lanes::select(stays, Lanes::ZERO, 0.25 * weights * size).element_sum();
                volume += (to - from).dot(old) / 6.0;
            }
            swept += (weights * volume * volume).element_sum();
        }
        let volume = swept / area.max(f32::MIN_POSITIVE);
        FLIP_WEIGHT * turned as f64 + VOLUME_WEIGHT * volume as f64
    }

    /// The cheapest way to give up a seam at `point`.
    fn best_twin(&mut self, point: u32) -> Option<(f64, Action)> {
        let s = &self.surface;
        let wedges = &s.wedges_of[point as usize];
        let mut best: Option<(f64, Action)> = None;
        for &from in wedges {
            // The twin that looks most like it; what that costs is then measured.
            let twin = wedges
                .iter()
                .copied()
                .filter(|&to| to != from)
                .filter(|&to| attributes::joins(s, from, to))
                .map(|to| {
                    (
                        attributes::difference(s, self.samples.looks(), from, to),
                        to,
                    )
                })
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            if let Some((_, to)) = twin {
                let cost = self.samples.try_twin(s, point, from, to);
                let cost = self.twin_cost(cost);
                if best.is_none_or(|b| cost < b.0) {
                    best = Some((cost, Action::Twin { from, to }));
                }
            }
        }
        best
    }

    fn perform(&mut self, proposal: Proposal) {
        match proposal.action {
            Action::Twin { from, to } => {
                self.samples
                    .try_twin(&self.surface, proposal.point, from, to);
                self.samples.commit_twin(&self.surface);
                self.retarget(proposal.point, from, to);
                let refitted = self.refit_look(proposal.point, to);
                self.raise_error();
                match refitted[..] {
                    [(_, new)] => {
                        self.step(from, new);
                        self.step(to, new);
                    }
                    _ => self.step(from, to),
                }
                self.enqueue(proposal.point);
            }
            Action::Collapse { target } => self.collapse(proposal.point, target),
        }
    }

    /// The error of the level that the next steps make. Errors of different points differ, if only by the last bit: any
    /// number of points can then be asked for.
    fn raise_error(&mut self) {
        // The diagonal is 1 here.
        let error = if self.pictured() {
            let wrong = self.wrong();
            self.note_level(wrong);
            match self.coarse.faces.is_empty() {
                // Pictures see but an area; a character that is gone is off by half its size.
                true => GONE_ERROR,
                false => self.coarse.error_factor * wrong.sqrt(),
            }
        } else {
            ERROR_FACTOR * self.samples.deviation().sqrt()
        };
        let error = (error * self.surface.unit as f64) as f32;
        self.error = if error > self.error || self.error == 0.0 {
            error.max(self.error)
        } else {
            self.error.next_up()
        };
    }

    /// Moves `point` onto `target` and proposes anew for all points that see it.
    fn collapse(&mut self, point: u32, target: u32) {
        let way = self.surface.way(target, point);
        let mut moves = std::mem::take(&mut self.moves);
        attributes::wedge_moves(
            &self.surface,
            self.samples.looks(),
            point,
            target,
            &mut moves,
        );
        if self.pictured() {
            self.carry(point, target, &mut moves);
        }
        self.samples
            .try_collapse(&self.surface, point, target, &moves);
        self.samples.commit_collapse(&self.surface, point);
        for m in &moves {
            if let Some(to) = m.to {
                self.retarget(point, m.from, to);
            }
        }
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
        self.living_points -= 1;
        let refitted = self.refit(target, way);
        let mut swept = self.sweep(target);
        swept.extend(self.settle());
        self.raise_error();
        for m in &mut moves {
            let new = refitted.iter().find(|r| Some(r.0) == m.to);
            m.to = new.map(|r| r.1).or(m.to);
            if let Some(to) = m.to.or_else(|| self.any_wedge(target, m.from)) {
                self.step(m.from, to);
            }
        }
        for (old, new) in refitted.into_iter().chain(swept) {
            self.step(old, new);
        }
        self.moves = moves;
        self.surface.wedges_of[point as usize].clear();
        self.stamps[point as usize] += 1;

        touched.sort_unstable();
        touched.dedup();
        for &p in &touched {
            self.drop_bare_wedges(p, target);
            // Also one that lost its only edge to the target, or it would still mean to collapse onto the dead point.
            self.dirty[p as usize] = true;
        }
        self.surface.neighbors(target, &mut touched);
        for p in touched {
            self.dirty[p as usize] = true;
        }
        self.leave_textures();
        self.turn_to_pictures();
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
            self.living_points -= 1;
            for link in std::mem::take(&mut s.links[point as usize]) {
                s.links[link as usize].retain(|&p| p != point);
                // It may have meant to collapse onto this one.
                self.dirty[link as usize] = true;
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
    fn finish(mut self, mesh: &mut Mesh) -> CollapseSequence {
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
        *mesh = self.surface.mesh;
        self.surface.sequence
    }
}
