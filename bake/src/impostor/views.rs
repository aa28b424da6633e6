//! View directions, their cells, and the cube map that finds a cell by direction.
//!
//! Directions are the vertices of an icosahedron whose edges are cut into equal parts. Their spherical Delaunay triangulation
//! comes from the plane: a stereographic projection from one of the sites keeps circles, so that the Delaunay triangles of
//! the other sites are triangles on the sphere too, and the hull's edges form the rest with the site that lies at infinity.
//!
//! Source: Izquierdo 2014, §3.1.3 and §4.2.1, where faces of a subdivided icosahedron stand for Voronoi cells; here the cells
//! are the exact ones.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use super::{CUBE_SIZE, ViewSet};

/// Most directions of a view set: the device's cube maps hold their numbers as halves, which are exact up to here.
pub const MAX_VIEWS: usize = 2048;

/// Cuts of the icosahedron among whose vertices directions are chosen.
const CANDIDATE_CUTS: u32 = 10;
/// Directions are chosen for eyes that look up by this much at least.
const LOWEST_Y: f32 = -0.1;
/// Times that directions move into the middle of their cells.
const LLOYD_STEPS: usize = 12;

impl ViewSet {
    /// The vertices of an icosahedron with every edge cut into `cuts` parts (`10 cuts^2 + 2`) whose height on the unit
    /// sphere is at least `lowest_y`, or a little less: some lie below the horizon, so that they surround the origin.
    pub fn icosahedral(cuts: u32, lowest_y: f32) -> Self {
        let all = icosahedral_directions(cuts.clamp(1, 20));
        let mut lowest_y = f64::from(lowest_y).max(-1.0);
        let mut directions = all.clone();
        loop {
            directions.retain(|d| d.y >= lowest_y);
            if lowest_y <= -1.0 || directions.iter().any(|d| d.y < -0.2) {
                break;
            }
            lowest_y -= 0.05;
            directions.clone_from(&all);
        }
        Self::of_directions(directions.into_iter().map(|d| d.as_vec3()).collect())
    }

    /// `count` directions, the last straight down and the others at least as high as `lowest_y`, the closer together the
    /// more depth `depth` says there is along them: a turn of the eye shifts what is deep. Also the root mean square, over
    /// all directions, of the shift to the nearest one: radians times the unit of `depth`.
    pub(super) fn spread(count: usize, lowest_y: f32, depth: impl Fn(Vec3) -> f32) -> (Self, f32) {
        let all = icosahedral_directions(CANDIDATE_CUTS);
        let all = all.into_iter().map(|d| d.as_vec3());
        let candidates: Vec<(Vec3, f32)> = all
            .filter(|d| d.y >= lowest_y.min(LOWEST_Y))
            .map(|d| (d, depth(d).sqrt()))
            .collect();
        // Square roots: in proportion, eyes just above the crowd, who are most, would have too few.
        let shift = |a: &(Vec3, f32), b: &(Vec3, f32)| {
            a.0.dot(b.0).clamp(-1.0, 1.0).acos() * 0.5 * (a.1 + b.1)
        };
        // Always the one that is farthest from those before it ...
        let mut sites: Vec<(Vec3, f32)> = Vec::new();
        let mut nearest = vec![(f32::INFINITY, 0); candidates.len()];
        while sites.len() + 1 < count.max(5) {
            let ends = nearest.iter().map(|n| n.0).enumerate();
            let farthest = ends.max_by(|a, b| a.1.total_cmp(&b.1));
            sites.push(candidates[farthest.map_or(0, |f| f.0)]);
            let at = sites.len() - 1;
            for (least, candidate) in nearest.iter_mut().zip(&candidates) {
                let to = shift(candidate, &sites[at]);
                if to < least.0 {
                    *least = (to, at);
                }
            }
        }
        // ... and then into the middle of those that it is nearest to (Lloyd 1982).
        for _ in 0..LLOYD_STEPS {
            let mut middles = vec![Vec3::ZERO; sites.len()];
            for (&(_, at), candidate) in nearest.iter().zip(&candidates) {
                middles[at] += candidate.1 * candidate.1 * candidate.0;
            }
            for (site, middle) in sites.iter_mut().zip(middles) {
                if let Some(middle) = middle.try_normalize() {
                    *site = (middle, depth(middle).sqrt());
                }
            }
            for (least, candidate) in nearest.iter_mut().zip(&candidates) {
                let all = sites.iter().map(|site| shift(candidate, site)).enumerate();
                let found = all.min_by(|a, b| a.1.total_cmp(&b.1));
                *least = found.map_or((0.0, 0), |(at, to)| (to, at));
            }
        }
        let shifts = nearest.iter().zip(&candidates);
        let squares = shifts.map(|(n, c)| (n.0 * c.1).powi(2)).sum::<f32>();
        let mean = (squares / nearest.len().max(1) as f32).sqrt();
        let mut directions: Vec<Vec3> = sites.into_iter().map(|s| s.0).collect();
        // All together surround the origin.
        directions.push(Vec3::NEG_Y);
        (Self::of_directions(directions), mean)
    }

    /// The view set of unit directions, which must hold the origin within their hull; there are at least 4.
    fn of_directions(directions: Vec<Vec3>) -> Self {
        let rights = directions.iter().map(|&d| right_of(d)).collect();
        let triangles = spherical_delaunay(&directions);
        let cells = (0..6 * CUBE_SIZE * CUBE_SIZE)
            .map(|i| cell(&directions, &triangles, texel_direction(i as usize)))
            .collect();
        Self {
            directions,
            rights,
            cells,
        }
    }

    /// The up axis of a direction's picture.
    pub fn up(&self, view: usize) -> Vec3 {
        self.directions[view].cross(self.rights[view])
    }

    /// The cell of the texel that holds `direction`, as a device samples a cube map with nearest filtering.
    pub fn lookup(&self, direction: Vec3) -> [u16; 4] {
        self.cells[texel_of(direction)]
    }
}

/// The right axis of the picture from `direction`: horizontal, so that pictures stand upright.
fn right_of(direction: Vec3) -> Vec3 {
    Vec3::Y.cross(direction).try_normalize().unwrap_or(Vec3::X)
}

/// Direction of a texel's centre, unit length; texels stand `[6][CUBE_SIZE][CUBE_SIZE]`.
pub fn texel_direction(texel: usize) -> Vec3 {
    let size = CUBE_SIZE as usize;
    let (face, row, column) = (texel / (size * size), texel / size % size, texel % size);
    let along = |i: usize| (2 * i + 1) as f32 / size as f32 - 1.0;
    let (s, t) = (along(column), along(row));
    let direction = match face {
        0 => Vec3::new(1.0, -t, -s),
        1 => Vec3::new(-1.0, -t, s),
        2 => Vec3::new(s, 1.0, t),
        3 => Vec3::new(s, -1.0, -t),
        4 => Vec3::new(s, -t, 1.0),
        _ => Vec3::new(-s, -t, -1.0),
    };
    direction.normalize()
}

/// The texel that a nearest sample at `direction` reads: the face of the largest component, z before y before x where they
/// tie (Vulkan 1.3, "Cube map face selection").
pub fn texel_of(direction: Vec3) -> usize {
    let (d, a) = (direction, direction.abs());
    let (face, s, t, major) = if a.z >= a.x && a.z >= a.y {
        if d.z >= 0.0 {
            (4, d.x, -d.y, a.z)
        } else {
            (5, -d.x, -d.y, a.z)
        }
    } else if a.y >= a.x {
        if d.y >= 0.0 {
            (2, d.x, d.z, a.y)
        } else {
            (3, d.x, -d.z, a.y)
        }
    } else if d.x >= 0.0 {
        (0, -d.z, -d.y, a.x)
    } else {
        (1, d.z, -d.y, a.x)
    };
    let size = CUBE_SIZE as usize;
    // A direction without length has no face; it reads the first texel of one.
    let at = |x: f32| ((0.5 * x / major + 0.5) * size as f32) as usize;
    (face * size + at(t).min(size - 1)) * size + at(s).min(size - 1)
}

/// Vertices of the subdivided icosahedron, unit length, in a fixed order.
fn icosahedral_directions(cuts: u32) -> Vec<DVec3> {
    let phi = (1.0 + 5.0f64.sqrt()) / 2.0;
    let mut corners = Vec::with_capacity(12);
    for axis in 0..3 {
        for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let mut corner = [0.0; 3];
            corner[axis] = a;
            corner[(axis + 1) % 3] = b * phi;
            corners.push(DVec3::from_array(corner));
        }
    }
    // Neighbours are 2 apart, all others further.
    let near = |a: usize, b: usize| corners[a].distance(corners[b]) < 2.1;
    let mut seen = HashMap::new();
    let mut directions = Vec::new();
    for a in 0..12 {
        for b in (a + 1..12).filter(|&b| near(a, b)) {
            for c in (b + 1..12).filter(|&c| near(a, c) && near(b, c)) {
                for i in 0..=cuts {
                    for k in 0..=cuts - i {
                        let weights = [cuts - i - k, i, k].map(f64::from);
                        let direction = (corners[a] * weights[0]
                            + corners[b] * weights[1]
                            + corners[c] * weights[2])
                            .normalize();
                        // Faces share the points of their edges, up to rounding.
                        let key = direction.to_array().map(|x| (x * 1e6).round() as i64);
                        seen.entry(key)
                            .or_insert_with(|| directions.push(direction));
                    }
                }
            }
        }
    }
    directions
}

/// A site in the stereographic plane.
struct Site {
    place: Point2<f64>,
    index: u16,
}

impl HasPosition for Site {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.place
    }
}

/// Triangles of the spherical Delaunay triangulation, counter-clockwise seen from outside.
fn spherical_delaunay(directions: &[Vec3]) -> Vec<[u16; 3]> {
    let sites: Vec<DVec3> = directions
        .iter()
        .map(|d| d.as_dvec3().normalize())
        .collect();
    let pole = sites[0];
    let (right, up) = pole.any_orthonormal_pair();
    let mut plane = DelaunayTriangulation::<Site>::new();
    for (index, site) in sites.iter().enumerate().skip(1) {
        let scale = 1.0 / (1.0 - site.dot(pole));
        let place = Point2::new(site.dot(right) * scale, site.dot(up) * scale);
        // Coordinates are finite and of ordinary size: distinct sites are never refused.
        let _ = plane.insert(Site {
            place,
            index: index as u16,
        });
    }
    let inner = plane
        .inner_faces()
        .map(|face| face.vertices().map(|v| v.data().index));
    let outer = plane
        .convex_hull()
        .map(|edge| [edge.from().data().index, edge.to().data().index, 0]);
    let outward = |[a, b, c]: [u16; 3]| {
        let site = |i: u16| sites[i as usize];
        if site(a).cross(site(b)).dot(site(c)) >= 0.0 {
            [a, b, c]
        } else {
            [a, c, b]
        }
    };
    inner.chain(outer).map(outward).collect()
}

/// The triangle that holds `direction`, its nearest corner first. Where the sites leave a gap (below the lowest), a site
/// beyond the triangle's edge may be nearer than its corners: then that site alone, three times.
fn cell(directions: &[Vec3], triangles: &[[u16; 3]], direction: Vec3) -> [u16; 4] {
    let site = |i: u16| directions[i as usize].as_dvec3();
    let d = direction.as_dvec3();
    // How far inside the nearest edge's plane; the triangle that holds the direction has the only value above 0.
    let inside = |t: &[u16; 3]| {
        let edge = |a: u16, b: u16| site(a).cross(site(b)).normalize().dot(d);
        edge(t[0], t[1]).min(edge(t[1], t[2])).min(edge(t[2], t[0]))
    };
    let mut best = ([0u16; 3], f64::NEG_INFINITY);
    for t in triangles {
        let depth = inside(t);
        if depth > best.1 {
            best = (*t, depth);
        }
    }
    let nearest = nearest_direction(directions, direction);
    let at = best.0.iter().position(|&i| i == nearest);
    match at {
        Some(at) => [best.0[at], best.0[(at + 1) % 3], best.0[(at + 2) % 3], 0],
        None => [nearest, nearest, nearest, 0],
    }
}

/// The direction with the smallest angle to `direction`, by trying all; the first of several.
pub fn nearest_direction(directions: &[Vec3], direction: Vec3) -> u16 {
    let mut best = (0, f32::NEG_INFINITY);
    for (i, d) in directions.iter().enumerate() {
        let cos = d.dot(direction);
        if cos > best.1 {
            best = (i as u16, cos);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A long body is deep from its ends: views crowd there, and none of the others is far from the next.
    #[test]
    fn directions_crowd_where_the_body_is_deep() {
        let depth = |d: Vec3| 0.2 + d.z.abs();
        let (set, shift) = ViewSet::spread(50, -0.15, depth);
        assert_eq!(set.directions.len(), 50);
        assert!(
            set.directions
                .iter()
                .all(|d| (d.length() - 1.0).abs() < 1e-5)
        );
        let sharing = |pole: Vec3| set.directions.iter().filter(|d| d.dot(pole) > 0.8).count();
        let (ends, sides) = (sharing(Vec3::Z) + sharing(Vec3::NEG_Z), sharing(Vec3::X));
        assert!(ends > 2 * sides, "{ends} at both ends, {sides} at a side");
        let (_, fewer) = ViewSet::spread(25, -0.15, depth);
        let halved = fewer / shift;
        assert!(
            (1.2..1.7).contains(&halved),
            "{halved}: half as many views, root 2 the shift"
        );
        let upper = set.directions.iter().filter(|d| d.y >= -0.16);
        assert_eq!(upper.count(), 49);
        let surrounded = [Vec3::X, Vec3::Y, Vec3::Z].map(|a| {
            let along = set.directions.iter().map(|d| d.dot(a));
            along.fold((1.0f32, -1.0f32), |(min, max), x| (min.min(x), max.max(x)))
        });
        assert!(
            surrounded
                .iter()
                .all(|(min, max)| *min < -0.8 && *max > 0.8)
        );
    }
}
