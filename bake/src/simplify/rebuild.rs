//! The coarse end built anew: pieces of a few triangles each, limb by limb, as an artist would make them, take the place of what
//! collapses have left where pictures say that they look more like the character.
//!
//! Shapes for all pieces are chosen together, with more triangles than are wanted; collapses chosen by pictures make them fewer, all
//! points are fitted together, and colours with them. Then the sequence goes on from there.

use std::collections::{HashMap, HashSet};

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::mesh::{Mesh, Replacement};

use super::coarse::{SETTLE_MOVES, SETTLED_SHARE, SETTLED_TRIANGLES, least_first};
use super::pictures::Change;
use super::shapes::{CornerLook, Shape, ShapePoint, shapes};
use super::surface::Face;
use super::{Rig, Simplifier, limbs};

/// Triangles with which shapes are chosen, before collapses make them fewer.
const RICH_TRIANGLES: usize = 64;
/// Fewest pieces that make a character.
const LEAST_PIECES: usize = 3;
/// Triangles of a piece's first shape, and how often shapes are chosen, each time beside the last choice.
const FIRST_TRIANGLES: usize = 8;
const CHOICES: usize = 2;
/// Rounds of fitting all points together, before collapses and after.
const ROUNDS: [usize; 2] = [2, 4];

/// A level among those that pictures chose.
#[derive(Clone)]
pub(super) struct PicturedLevel {
    /// Steps before the first that makes it.
    pub first_step: usize,
    /// Vertices of the mesh at that time.
    pub vertex_count: usize,
    /// Its triangles, those that are the same counted once.
    pub triangles: usize,
    /// Area of what it gets wrong in the pictures.
    pub wrong: f64,
}

/// What there was before anything was planted.
struct Base {
    points: usize,
    vertices: usize,
    faces: usize,
    steps: usize,
    /// Submesh of the new triangles.
    submesh: u8,
}

/// Points and wedges of the faces of a shape, now that it stands among the surface's points.
type Planted = Vec<([u32; 3], [u32; 3])>;

impl Simplifier<'_> {
    /// Writes down the level that the next steps make, which is `wrong`.
    pub(super) fn note_level(&mut self, wrong: f64) {
        let level = PicturedLevel {
            first_step: self.surface.sequence.steps.len(),
            vertex_count: self.surface.mesh.vertex_count(),
            triangles: self.drawn(),
            wrong,
        };
        self.coarse.levels.push(level);
    }

    /// This simplifier with its coarse end built anew, the level of [`SETTLED_TRIANGLES`] having been reached. None where that
    /// looks no better, or nothing is known of limbs.
    pub(super) fn rebuilt(&self, rig: &Rig) -> Option<Self> {
        let (mesh, looks) = (&self.surface.mesh, self.samples.looks());
        let pieces = limbs::pieces(mesh, looks, rig, &self.samples.visibility);
        let submesh = self.home()?;
        if pieces.len() < LEAST_PIECES || self.coarse.levels.is_empty() {
            return None;
        }
        let menu: Vec<Vec<Shape>> = pieces.par_iter().map(|p| shapes(mesh, p)).collect();
        let mut new = self.clone();
        new.rebuild(submesh, &menu).then_some(new)
    }

    /// Builds the coarse end anew of the `menu` of shapes for each piece, and proposes what can be done to it; false where that
    /// looks no better.
    fn rebuild(&mut self, submesh: u8, menu: &[Vec<Shape>]) -> bool {
        let mut base = Base {
            points: self.surface.faces_of.len(),
            vertices: self.surface.mesh.vertex_count(),
            faces: self.surface.faces.len(),
            steps: self.surface.sequence.steps.len(),
            submesh,
        };
        let s = &mut self.surface;
        s.faces.iter_mut().for_each(|f| f.alive = false);
        s.faces_of.iter_mut().for_each(Vec::clear);
        s.links.iter_mut().for_each(Vec::clear);
        self.coarse.rebuilt = true;
        let levels = std::mem::take(&mut self.coarse.levels);
        let mut shape = Shape::default();
        for (menu, choice) in menu.iter().zip(self.choose(&base, menu)) {
            if let Some(i) = choice {
                shape.append(&menu[i]);
            }
        }
        self.replant(&base, &shape, true);
        self.samples.restart(&self.surface);
        self.settle_together(&base, &mut shape, ROUNDS[0]);
        self.reduce(&base, shape.points.len());

        let mut shape = self.living_shape();
        let planted = self.replant(&base, &shape, true);
        self.fit_looks(&base, &planted, &mut shape);
        shape.weld();
        let planted = self.replant(&base, &shape, false);
        self.samples.restart(&self.surface);
        self.fit_looks(&base, &planted, &mut shape);
        self.settle_together(&base, &mut shape, ROUNDS[1]);
        self.fit_looks(&base, &planted, &mut shape);
        let wrong = self.wrong();
        // All levels behind the last that is better give way.
        let first = levels.iter().rposition(|l| l.wrong < wrong);
        let first = first.map_or(0, |i| i + 1);
        let coarser = first > 0 && levels[first - 1].triangles < shape.faces.len();
        if coarser || first == levels.len() || shape.faces.is_empty() {
            return false;
        }
        base.vertices = levels[first].vertex_count;
        base.steps = levels[first].first_step;
        self.replace(&base, &shape, wrong);
        true
    }

    /// The submesh that new triangles go into: opaque, of one side where possible, the largest.
    fn home(&self) -> Option<u8> {
        let m = &self.surface.mesh;
        let mut counts = vec![0usize; m.submeshes.len()];
        for t in &m.triangles {
            counts[m.submesh[t[0] as usize] as usize] += 1;
        }
        let order = |i: &usize| {
            let s = &m.submeshes[*i];
            (s.alpha_cutoff.is_none(), !s.double_sided, counts[*i])
        };
        let filled = (0..counts.len()).filter(|&i| counts[i] > 0);
        u8::try_from(filled.max_by_key(order)?).ok()
    }

    /// For each piece the one of its shapes, none for some, that together are the least wrong.
    fn choose(&mut self, base: &Base, menu: &[Vec<Shape>]) -> Vec<Option<usize>> {
        let planted: Vec<Vec<Planted>> = (menu.iter())
            .map(|m| m.iter().map(|s| self.plant(base, s, true)).collect())
            .collect();
        self.coarse.pictures.place_new(&self.surface);
        self.learn();
        let first = |m: &Vec<Shape>| {
            let triangles = |&i: &usize| m[i].faces.len().abs_diff(FIRST_TRIANGLES);
            (0..m.len()).min_by_key(triangles)
        };
        let mut chosen: Vec<Option<usize>> = menu.iter().map(first).collect();
        for _ in 0..CHOICES {
            let mut costs: Vec<Vec<f64>> = Vec::new();
            for piece in 0..menu.len() {
                let faces = &mut self.surface.faces;
                faces.truncate(base.faces);
                for (other, choice) in chosen.iter().enumerate() {
                    if let (true, Some(i)) = (other != piece, choice) {
                        faces.extend(planted[other][*i].iter().map(face_of));
                    }
                }
                let others: Vec<u32> = (base.faces as u32..faces.len() as u32).collect();
                let changes = planted[piece].iter().map(|faces| Change {
                    faces: faces.clone(),
                    moved: None,
                });
                let changes: Vec<Change> = changes.collect();
                let pictures = &self.coarse.pictures;
                costs.push(pictures.compare(&self.surface, &others, &[], &changes));
            }
            let next = cheapest(menu, &costs, RICH_TRIANGLES);
            if next == chosen {
                break;
            }
            chosen = next;
        }
        chosen
    }

    /// New points and wedges for a shape. Its corners share wedges where they look the same, unless they are to be `apart`.
    fn plant(&mut self, base: &Base, shape: &Shape, apart: bool) -> Planted {
        let s = &mut self.surface;
        let like = (s.mesh.submesh.iter()).position(|&x| x == base.submesh);
        let like = like.unwrap_or(0) as u32;
        let points = shape.points.iter();
        let points: Vec<u32> = points
            .map(|p| s.add_point(like, p.at, p.joints, p.weights))
            .collect();
        // Of each point: its first vertex waits for a look.
        let mut bare = vec![true; points.len()];
        let mut planted = Vec::with_capacity(shape.faces.len());
        for (face, looks) in shape.faces.iter().zip(&shape.looks) {
            let wedges = [0, 1, 2].map(|i| {
                let wedges = &s.wedges_of[points[face[i]] as usize];
                let CornerLook {
                    normal,
                    color,
                    part,
                } = looks[i];
                let color = (color * 255.0).round().to_array().map(|c| c as u8);
                if !std::mem::take(&mut bare[face[i]]) {
                    let m = &s.mesh;
                    let looks_so = |&&w: &&u32| {
                        let w = w as usize;
                        let same = m.normals[w] == normal && m.colors[w] == color;
                        same && m.body_parts[w] == part
                    };
                    if let Some(&same) = wedges.iter().find(looks_so).filter(|_| !apart) {
                        return same;
                    }
                    let new = s.add_wedge(wedges[0]);
                    s.wedges_of[points[face[i]] as usize].push(new);
                }
                let w = s.wedges_of[points[face[i]] as usize].last();
                let w = w.copied().unwrap_or(like);
                let (m, i) = (&mut s.mesh, w as usize);
                (m.layers[i], m.uvs[i]) = (Mesh::UNTEXTURED, Vec2::ZERO);
                (m.normals[i], m.colors[i], m.body_parts[i]) = (normal, color, part);
                w
            });
            planted.push((face.map(|i| points[i]), wedges));
        }
        planted
    }

    /// Lets a shape be all that the surface is, in place of whatever was planted before.
    fn replant(&mut self, base: &Base, shape: &Shape, apart: bool) -> Planted {
        let s = &mut self.surface;
        s.faces.truncate(base.faces);
        s.areas.truncate(base.faces);
        s.drop_points(base.points, base.vertices);
        s.sequence.steps.truncate(base.steps);
        self.coarse.pictures.forget_places(base.points);
        self.learn();
        let planted = self.plant(base, shape, apart);
        let s = &mut self.surface;
        for face in &planted {
            let f = s.faces.len() as u32;
            s.faces.push(face_of(face));
            for p in face.0 {
                s.faces_of[p as usize].push(f);
            }
            s.areas.push(s.face_area(face.0));
        }
        self.living_points = shape.points.len();
        self.coarse.faces.clear();
        self.coarse.pictures.place_new(&self.surface);
        self.learn();
        self.quadrics.resize(self.surface.faces_of.len());
        planted
    }

    /// Fits the looks of planted faces.
    fn fit_looks(&mut self, base: &Base, planted: &Planted, shape: &mut Shape) {
        self.forget_dead_faces();
        let coarse = &self.coarse;
        let fits = coarse.pictures.fit_looks(&self.surface, &coarse.faces);
        let m = &mut self.surface.mesh;
        for (w, color, part) in fits {
            let [r, g, b] = (color * 255.0).round().to_array().map(|c| c as u8);
            m.colors[w as usize] = [r, g, b, 255];
            m.body_parts[w as usize] = part;
        }
        for ((_, wedges), looks) in planted.iter().zip(&mut shape.looks) {
            *looks = wedges.map(|w| look_of(m, w));
        }
        self.coarse.pictures.forget_looks(base.vertices);
        self.learn();
    }

    /// Fits all points of a planted shape together, several times.
    fn settle_together(&mut self, base: &Base, shape: &mut Shape, rounds: usize) {
        let mut before = self.wrong();
        for _ in 0..rounds {
            for (p, point) in shape.points.iter_mut().zip(base.points as u32..) {
                p.at += self.place_by_pictures(point, &SETTLE_MOVES, Vec3::ZERO);
            }
            let after = self.wrong();
            if after > SETTLED_SHARE * before {
                break;
            }
            before = after;
        }
        for (p, wedges) in shape
            .points
            .iter()
            .zip(&self.surface.wedges_of[base.points..])
        {
            for &w in wedges {
                self.surface.mesh.positions[w as usize] = p.at;
            }
        }
    }

    /// Collapses planted faces until there are no more than [`SETTLED_TRIANGLES`].
    fn reduce(&mut self, base: &Base, points: usize) {
        self.coarse.settled = false;
        self.begin_again(base, points);
        while self.drawn() > SETTLED_TRIANGLES && self.perform_next() {}
    }

    /// Proposes what can be done to the `points` planted points.
    fn begin_again(&mut self, base: &Base, points: usize) {
        let count = base.points + points;
        self.coarse.swept = Some(points);
        self.cursor.fill(base.faces);
        self.heap.clear();
        for stamp in &mut self.stamps {
            // Nothing that was proposed before means these points.
            *stamp += 1;
        }
        self.stamps.resize(count, 0);
        self.collapses.clear();
        self.collapses.resize(count, None);
        self.dirty.clear();
        self.dirty.resize(count, false);
        self.weighed.clear();
        self.weighed.resize(count, 0.0);
        for point in base.points..count {
            self.propose(point as u32);
        }
    }

    /// The living faces as a shape.
    fn living_shape(&mut self) -> Shape {
        self.forget_dead_faces();
        let (s, mut shape) = (&self.surface, Shape::default());
        let m = &s.mesh;
        let (mut places, mut seen) = (HashMap::new(), HashSet::new());
        for &f in &self.coarse.faces {
            let face = &s.faces[f as usize];
            if !seen.insert(least_first(face.wedges)) {
                continue;
            }
            let corner = |i: usize| {
                *places.entry(face.points[i]).or_insert_with(|| {
                    let w = face.wedges[i] as usize;
                    shape.points.push(ShapePoint {
                        at: m.positions[w],
                        joints: m.joints[w],
                        weights: m.weights[w],
                    });
                    shape.points.len() - 1
                })
            };
            shape.faces.push([0, 1, 2].map(corner));
            shape.looks.push(face.wedges.map(|w| look_of(m, w)));
        }
        shape
    }

    /// Ends the sequence so far with a step of all that lives onto `shape`, which is `wrong`, and goes on from there.
    fn replace(&mut self, base: &Base, shape: &Shape, wrong: f64) {
        // The same points and faces as before, so that samples stay where they are.
        let planted = self.replant(base, shape, false);
        let steps = &self.surface.sequence.steps;
        let last = steps.last().map_or(0.0, |s| s.error_m);
        let error = self.coarse.error_factor * wrong.sqrt() * self.surface.unit as f64;
        self.error = (error as f32).max(last.next_up());
        let mut dead = vec![false; base.vertices];
        for step in steps {
            dead[step.vertex as usize] = true;
        }
        let m = &self.surface.mesh;
        let nearest = |v: usize| {
            let gap = |w: &usize| m.positions[*w].distance_squared(m.positions[v]);
            let alike = (base.vertices..m.vertex_count()).filter(|&w| m.submesh[w] == m.submesh[v]);
            alike.min_by(|a, b| gap(a).total_cmp(&gap(b)))
        };
        // Submeshes that have no part in the shape keep one vertex.
        let mut roots = vec![None; m.submeshes.len()];
        let mut steps = Vec::new();
        for v in (0..base.vertices).filter(|&v| !dead[v]) {
            let root = *roots[m.submesh[v] as usize].get_or_insert(v);
            let target = nearest(v).unwrap_or(root);
            if target != v {
                steps.push((v as u32, target as u32));
            }
        }
        for wedges in &mut self.surface.wedges_of[..base.points] {
            wedges.clear();
        }
        for (v, target) in steps {
            self.step(v, target);
        }
        self.surface.sequence.replacement = Some(Replacement {
            step: base.steps,
            triangles: planted.into_iter().map(|f| f.1).collect(),
        });
        self.coarse.settled = true;
        self.begin_again(base, shape.points.len());
    }
}

/// A living face.
fn face_of(&(points, wedges): &([u32; 3], [u32; 3])) -> Face {
    Face {
        wedges,
        points,
        alive: true,
    }
}

/// What a vertex without a texture looks like.
fn look_of(mesh: &Mesh, wedge: u32) -> CornerLook {
    let w = wedge as usize;
    CornerLook {
        normal: mesh.normals[w],
        color: Vec4::from(mesh.colors[w].map(f32::from)) / 255.0,
        part: mesh.body_parts[w],
    }
}

/// One of the shapes of each piece, or none, with the least cost in all and at most `budget` triangles.
fn cheapest(menu: &[Vec<Shape>], costs: &[Vec<f64>], budget: usize) -> Vec<Option<usize>> {
    // By triangles spent: the least cost of the pieces so far, and the shapes that have it.
    let mut best: Vec<(f64, Vec<Option<usize>>)> = vec![(0.0, Vec::new()); budget + 1];
    for (shapes, costs) in menu.iter().zip(costs) {
        let spend = |spent: usize| {
            let mut least = (best[spent].0, spent, None);
            for (i, (shape, cost)) in shapes.iter().zip(costs).enumerate() {
                if let Some(left) = spent.checked_sub(shape.faces.len())
                    && best[left].0 + cost < least.0
                {
                    least = (best[left].0 + cost, left, Some(i));
                }
            }
            let mut chosen = best[least.1].1.clone();
            chosen.push(least.2);
            (least.0, chosen)
        };
        best = (0..=budget).map(spend).collect();
    }
    best.pop().map_or_else(Vec::new, |b| b.1)
}
