//! The coarse end of a sequence, where pictures of the character choose collapses, and at last also say where points stand.

use std::collections::HashSet;

use glam::Vec3;

use super::pictures::{Change, Pictures};
use super::rebuild::PicturedLevel;
use super::{Action, Simplifier, attributes};

/// Points from which on pictures choose.
pub(super) const PICTURE_POINTS: usize = 80;
/// Share of the points after which all of them are fitted again.
const SWEEP_SHARE: f64 = 0.8;
/// Lengths by which points are moved to try, as shares of the character's size.
pub(super) const MOVES: [f32; 3] = [0.04, 0.02, 0.01];
/// Moves of one length that a point may make.
const MOVES_EACH: usize = 2;
/// Least gain that is worth a move: wrong area in the pictures, as a share of the character's size squared.
const LEAST_GAIN: f64 = 1e-5;
/// Targets whose collapse is also compared with its point in between, the best by pictures.
const VARIED: usize = 4;
/// Shares of the way back to the dying point at which the one that stays is tried.
const WAY_SHARES: [f32; 2] = [0.35, 0.7];
/// Points from which on pictures also say where the others stand. With more, distances say it better: pictures of this size
/// and number would be fitted, not the character.
const MOVE_POINTS: usize = 65;
/// Triangles of the level at which all points are fitted together, how often at most, by which lengths, and the share of
/// the wrong area from which another round gains too little.
pub(super) const SETTLED_TRIANGLES: usize = 40;
const SETTLE_ROUNDS: usize = 4;
pub(super) const SETTLE_MOVES: [f32; 3] = [0.03, 0.015, 0.0075];
pub(super) const SETTLED_SHARE: f64 = 0.99;
/// What pictures do not see (other poses and sides, light) adds to the error.
const UNSEEN: f64 = 1.1;
/// Range of [`Coarse::error_factor`] before that; real characters have 0.40 to 0.53.
const ERROR_FACTORS: [f64; 2] = [0.3, 0.7];
/// Wrong area in pictures that giving up a seam counts, for contrast times surface. Pictures show about a quarter of a
/// surface; seams count many times as much, because they keep colours of head and clothes apart and cost no triangle.
const TWIN_WEIGHT: f64 = 4.0;

/// What pictures need between collapses.
#[derive(Clone)]
pub(super) struct Coarse {
    pub pictures: Pictures,
    /// Living faces, by index.
    pub faces: Vec<u32>,
    /// Living points at the last sweep; none before pictures choose.
    pub swept: Option<usize>,
    /// Error over the square root of the wrong area: errors go on where distances have left off. An outline of length L that
    /// is off by d is a wrong area of L * d, so both measures mean the same.
    pub error_factor: f64,
    /// All points have been fitted together at [`SETTLED_TRIANGLES`].
    pub settled: bool,
    /// The coarse end has been built anew: samples stay with their faces where points move, for only pictures are asked then.
    pub rebuilt: bool,
    /// The levels that pictures chose.
    pub levels: Vec<PicturedLevel>,
}

impl Simplifier<'_> {
    /// Whether pictures choose.
    pub(super) fn pictured(&self) -> bool {
        self.coarse.swept.is_some()
    }

    /// Lets pictures choose from here on if there are few points.
    pub(super) fn turn_to_pictures(&mut self) {
        if self.pictured() || !self.refits() || self.living_points > PICTURE_POINTS {
            return;
        }
        self.coarse.swept = Some(self.living_points);
        self.forget_dead_faces();
        self.learn();
        self.coarse.pictures.place_all(&self.surface);
        let coarse = &self.coarse;
        let wrong = coarse.pictures.wrong(&self.surface, &coarse.faces);
        let factor = (self.error / self.surface.unit) as f64 / wrong.sqrt().max(1e-6);
        let [least, most] = ERROR_FACTORS;
        self.coarse.error_factor = UNSEEN * factor.clamp(least, most);
        self.heap.clear();
        for point in 0..self.surface.faces_of.len() as u32 {
            if !self.surface.faces_of[point as usize].is_empty() {
                self.propose(point);
            }
        }
    }

    /// Whether pictures say where points stand.
    pub(super) fn placed_by_pictures(&self) -> bool {
        self.pictured() && self.living_points <= MOVE_POINTS
    }

    /// Lets the pictures know of new wedges.
    pub(super) fn learn(&mut self) {
        if self.pictured() {
            let pictures = &mut self.coarse.pictures;
            pictures.learn(&self.surface, self.samples.looks());
        }
    }

    pub(super) fn forget_dead_faces(&mut self) {
        let faces = &self.surface.faces;
        if self.coarse.faces.is_empty() {
            self.coarse.faces = (0..faces.len() as u32).collect();
        }
        self.coarse.faces.retain(|&f| faces[f as usize].alive);
    }

    /// Area of what the level gets wrong in the pictures.
    pub(super) fn wrong(&mut self) -> f64 {
        self.forget_dead_faces();
        let coarse = &self.coarse;
        coarse.pictures.wrong(&self.surface, &coarse.faces)
    }

    /// The best collapse of `point`, by pictures: the least wrong area for each two triangles that it saves.
    pub(super) fn best_in_pictures(&mut self, point: u32) -> Option<(f64, Action)> {
        let mut targets = std::mem::take(&mut self.targets);
        self.surface.neighbors(point, &mut targets);
        let (mut changes, mut choices) = (Vec::new(), Vec::new());
        for &target in &targets {
            let (surface, looks) = (&self.surface, self.samples.looks());
            if attributes::wedge_moves(surface, looks, point, target, &mut self.moves) {
                changes.push(self.without(point, target));
                choices.push(target);
            }
        }
        self.targets = targets;
        self.forget_dead_faces();
        let coarse = &self.coarse;
        let wrong = (coarse.pictures).compare(&self.surface, &coarse.faces, &[point], &changes);
        let mut costs: Vec<(f64, usize)> = wrong.into_iter().zip(0..).collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(f64, Action)> = None;
        for (rank, (mut cost, i)) in costs.into_iter().enumerate() {
            let target = choices[i];
            let saved = self.saved(point, target, &changes[i]).max(1) as f64 / 2.0;
            if rank < VARIED && self.placed_by_pictures() {
                for wrong in self.wrong_between(point, target, &changes[i]) {
                    cost = cost.min(wrong);
                }
            }
            // What makes pictures better is the better the more it saves.
            let cost = if cost > 0.0 {
                cost / saved
            } else {
                cost * saved
            };
            if best.is_none_or(|b| cost < b.0) {
                best = Some((cost, Action::Collapse { target }));
            }
        }
        best
    }

    /// The faces around `point` once it has moved onto `target`.
    fn without(&mut self, point: u32, target: u32) -> Change {
        let (surface, looks) = (&self.surface, self.samples.looks());
        let moves = &mut self.moves;
        attributes::wedge_moves(surface, looks, point, target, moves);
        attributes::keep_looks(surface, looks, target, moves);
        let faces = (surface.faces_of[point as usize].iter())
            .map(|&f| &surface.faces[f as usize])
            .filter(|f| !f.has(target))
            .map(|f| {
                let points = f.points.map(|p| if p == point { target } else { p });
                (points, f.wedges.map(|w| attributes::moved(moves, w)))
            });
        Change {
            faces: faces.collect(),
            moved: None,
        }
    }

    /// Triangles that are no longer drawn once `point` has moved onto `target`, whose faces `change` has. Where layers of a
    /// surface have come together, several faces are one triangle.
    fn saved(&self, point: u32, target: u32, change: &Change) -> usize {
        let s = &self.surface;
        let around = |p: u32| s.faces_of[p as usize].iter().map(|&f| &s.faces[f as usize]);
        let both = around(point).chain(around(target));
        let before: HashSet<_> = both.map(|f| least_first(f.wedges)).collect();
        let others = around(target).filter(|f| !f.has(point)).map(|f| f.wedges);
        let new = change.faces.iter().map(|f| f.1);
        let after: HashSet<_> = others.chain(new).map(least_first).collect();
        before.len().saturating_sub(after.len())
    }

    /// Change of the wrong area if `point` moves onto `target`, as `change` has it, and that to places in between.
    fn wrong_between(&mut self, point: u32, target: u32, change: &Change) -> Vec<f64> {
        let s = &mut self.surface;
        let mut faces = change.faces.clone();
        let others = s.faces_of[target as usize].iter();
        let others = others.map(|&f| &s.faces[f as usize]);
        faces.extend(
            others
                .filter(|f| !f.has(point))
                .map(|f| (f.points, f.wedges)),
        );
        let per_pose = s.steps_of(target);
        let start = s.posed_of(target).to_vec();
        let way = s.way(target, point);
        let mut changes = Vec::new();
        for share in WAY_SHARES {
            if s.place(target, &start, &per_pose, way * share) {
                changes.push(Change {
                    faces: faces.clone(),
                    moved: Some((target, s.posed_of(target).to_vec())),
                });
            }
        }
        s.place(target, &start, &per_pose, Vec3::ZERO);
        let (s, coarse) = (&self.surface, &self.coarse);
        (coarse.pictures).compare(s, &coarse.faces, &[point, target], &changes)
    }

    /// Cost of a twin beside wrong areas in pictures.
    pub(super) fn twin_cost(&self, cost: f64) -> f64 {
        if self.pictured() {
            cost * TWIN_WEIGHT / self.samples.look_weight()
        } else {
            cost
        }
    }

    /// Moves `point` to where pictures get better, perhaps along `way`; how far, in bind space.
    pub(super) fn place_by_pictures(&mut self, point: u32, lengths: &[f32], way: Vec3) -> Vec3 {
        self.forget_dead_faces();
        let per_pose = self.surface.steps_of(point);
        let start = self.surface.posed_of(point).to_vec();
        let faces = self.surface.faces_of[point as usize].iter().map(|&f| {
            let face = &self.surface.faces[f as usize];
            (face.points, face.wedges)
        });
        let faces: Vec<_> = faces.collect();
        let mut best = (-LEAST_GAIN, Vec3::ZERO);
        let fitted = self.samples.better_place(&self.surface, point, &per_pose);
        let mut tried: Vec<Vec3> = fitted.into_iter().collect();
        if way != Vec3::ZERO {
            tried.extend(WAY_SHARES.map(|share| way * share));
        }
        for &length in lengths {
            let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|a| a * length * self.surface.unit);
            for _ in 0..MOVES_EACH {
                tried.extend(axes.iter().flat_map(|&a| [best.1 + a, best.1 - a]));
                let (mut changes, mut offsets) = (Vec::new(), Vec::new());
                for offset in tried.drain(..) {
                    let s = &mut self.surface;
                    if s.place(point, &start, &per_pose, offset) {
                        changes.push(Change {
                            faces: faces.clone(),
                            moved: Some((point, s.posed_of(point).to_vec())),
                        });
                        offsets.push(offset);
                    }
                    s.place(point, &start, &per_pose, Vec3::ZERO);
                }
                let coarse = &self.coarse;
                let wrong =
                    (coarse.pictures).compare(&self.surface, &coarse.faces, &[point], &changes);
                let costs = wrong.into_iter().zip(offsets);
                match costs.min_by(|a, b| a.0.total_cmp(&b.0)) {
                    Some(better) if better.0 < best.0 - LEAST_GAIN => best = better,
                    _ => break,
                }
            }
        }
        let s = &mut self.surface;
        s.place(point, &start, &per_pose, best.1);
        if best.1 != Vec3::ZERO {
            if !self.coarse.rebuilt {
                self.samples.try_place(s, point);
                self.samples.commit_collapse(s, point);
            }
            self.coarse.pictures.place(s, point);
        }
        best.1
    }

    /// Fits all points but `busy` again where there are fewer by a share than the last time. Each wedge that is replaced, with
    /// the one that takes its place.
    pub(super) fn sweep(&mut self, busy: u32) -> Vec<(u32, u32)> {
        let due = |swept: usize| self.living_points as f64 <= SWEEP_SHARE * swept as f64;
        if !self.placed_by_pictures() || !self.coarse.swept.is_some_and(due) {
            return Vec::new();
        }
        self.coarse.swept = Some(self.living_points);
        let mut renewed = Vec::new();
        for point in 0..self.surface.faces_of.len() as u32 {
            if point != busy && !self.surface.faces_of[point as usize].is_empty() {
                renewed.extend(self.refit_by_pictures(point, &MOVES[1..], Vec3::ZERO));
            }
        }
        self.dirty.fill(true);
        renewed
    }

    /// Lets wedges of the dying `point` that look like none at `target` go on there as vertices of their own: colours of
    /// head and clothes stay apart, and cost no triangle. Notes them in `moves`.
    pub(super) fn carry(&mut self, point: u32, target: u32, moves: &mut [attributes::WedgeMove]) {
        attributes::keep_looks(&self.surface, self.samples.looks(), target, moves);
        for m in moves.iter_mut().filter(|m| m.to.is_none()) {
            let s = &mut self.surface;
            let goes_on = s.faces_of[point as usize].iter().any(|&f| {
                let face = &s.faces[f as usize];
                !face.has(target) && face.wedge_at(point) == m.from
            });
            if goes_on {
                m.to = Some(s.carry_wedge(m.from, target));
            }
        }
        self.learn();
    }

    /// Triangles of the level, those that are the same counted once.
    pub(super) fn drawn(&mut self) -> usize {
        self.forget_dead_faces();
        let faces = self.coarse.faces.iter();
        let drawn = faces.map(|&f| least_first(self.surface.faces[f as usize].wedges));
        drawn.collect::<HashSet<_>>().len()
    }

    /// Fits all points together, several times, at the level that is asked for most. Each wedge that is replaced, with the one
    /// that takes its place.
    pub(super) fn settle(&mut self) -> Vec<(u32, u32)> {
        if !self.pictured() || self.coarse.settled {
            return Vec::new();
        }
        if self.drawn() > SETTLED_TRIANGLES {
            return Vec::new();
        }
        self.coarse.settled = true;
        let points = 0..self.surface.faces_of.len() as u32;
        let points = points.filter(|&p| !self.surface.faces_of[p as usize].is_empty());
        let mut points: Vec<(u32, Vec3)> = points.map(|p| (p, Vec3::ZERO)).collect();
        let mut before = self.wrong();
        for _ in 0..SETTLE_ROUNDS {
            for (point, offset) in &mut points {
                *offset += self.place_by_pictures(*point, &SETTLE_MOVES, Vec3::ZERO);
            }
            let after = self.wrong();
            if after > SETTLED_SHARE * before {
                break;
            }
            before = after;
        }
        let mut renewed = Vec::new();
        for (point, offset) in points {
            renewed.extend(self.refit_looks(point, offset));
        }
        self.dirty.fill(true);
        renewed
    }

    /// Fits a point as pictures have it, see [`Simplifier::place_by_pictures`]. Each wedge that is replaced, with the one that takes its place.
    pub(super) fn refit_by_pictures(
        &mut self,
        point: u32,
        lengths: &[f32],
        way: Vec3,
    ) -> Vec<(u32, u32)> {
        let offset = self.place_by_pictures(point, lengths, way);
        self.refit_looks(point, offset)
    }

    /// New vertices for a point that has moved by `offset` in bind space. The same result.
    fn refit_looks(&mut self, point: u32, offset: Vec3) -> Vec<(u32, u32)> {
        let s = &mut self.surface;
        for f in s.faces_of[point as usize].clone() {
            s.areas[f as usize] = s.face_area(s.faces[f as usize].points);
        }
        let wedges = s.wedges_of[point as usize].clone();
        self.refit_wedges(point, &wedges, offset)
    }
}

/// The same triangle, its smallest corner first.
pub(super) fn least_first(c: [u32; 3]) -> [u32; 3] {
    let first = (0..3).min_by_key(|&i| c[i]).unwrap_or(0);
    [0, 1, 2].map(|i| c[(first + i) % 3])
}
