//! View cells against brute force.

use glam::Vec3;
use throng_bake::impostor::views::{nearest_direction, texel_direction, texel_of};
use throng_bake::impostor::{CUBE_SIZE, ViewSet};

use crate::common::Random;

fn sets() -> Vec<ViewSet> {
    vec![
        ViewSet::icosahedral(1, -1.0),
        ViewSet::icosahedral(3, -1.0),
        ViewSet::icosahedral(4, -1.0),
        ViewSet::icosahedral(3, -0.3),
        ViewSet::icosahedral(2, -0.3),
    ]
}

fn random_direction(random: &mut Random) -> Vec3 {
    loop {
        let mut axis = || random.below(2_000_001) as f32 / 1e6 - 1.0;
        let v = Vec3::new(axis(), axis(), axis());
        if (0.01..=1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

#[test]
fn subdivided_icosahedra_have_the_expected_directions_and_upright_axes() {
    for (cuts, lowest_y, count) in [(1, -1.0, 12), (3, -1.0, 92), (4, -1.0, 162)] {
        assert_eq!(ViewSet::icosahedral(cuts, lowest_y).directions.len(), count);
    }
    let coarse = ViewSet::icosahedral(2, 0.0);
    assert!(
        coarse.directions.iter().any(|d| d.y < -0.2),
        "they surround the origin"
    );
    let upper = ViewSet::icosahedral(3, -0.3);
    assert!(upper.directions.iter().all(|d| d.y >= -0.3));
    assert!(
        (50..80).contains(&upper.directions.len()),
        "{}",
        upper.directions.len()
    );
    for set in sets() {
        for (i, &d) in set.directions.iter().enumerate() {
            let (right, up) = (set.rights[i], set.up(i));
            assert!((d.length() - 1.0).abs() < 1e-6 && (right.length() - 1.0).abs() < 1e-6);
            assert!(right.dot(d).abs() < 1e-6 && right.y == 0.0 && up.y >= -1e-6);
            assert!(
                right.cross(up).dot(d) > 0.999,
                "the eye is on the side of right x up"
            );
        }
    }
}

#[test]
fn the_nearest_direction_of_every_texel_centre_is_right() {
    for set in sets() {
        assert_eq!(set.cells.len(), (6 * CUBE_SIZE * CUBE_SIZE) as usize);
        for (i, cell) in set.cells.iter().enumerate() {
            let center = texel_direction(i);
            assert_eq!(
                cell[0],
                nearest_direction(&set.directions, center),
                "texel {i}"
            );
            assert_eq!(texel_of(center), i, "a sample at a texel's centre reads it");
        }
    }
}

#[test]
fn a_cells_triangle_holds_the_texel_centre_and_no_site_lies_in_its_circle() {
    for set in sets() {
        let lowest_y = set.directions.iter().fold(1.0f32, |y, d| y.min(d.y));
        for (i, cell) in set.cells.iter().enumerate() {
            let center = texel_direction(i);
            let [a, b, c] = [0, 1, 2].map(|k| set.directions[cell[k] as usize]);
            if cell[0] == cell[1] {
                assert_eq!(cell[0], cell[2]);
                assert!(
                    center.y < lowest_y + 0.25,
                    "texel {i}: only a gap has no triangle"
                );
                continue;
            }
            for (from, to) in [(a, b), (b, c), (c, a)] {
                assert!(from.cross(to).dot(center) > -1e-6, "texel {i} lies outside");
            }
            let normal = (b - a).cross(c - a).normalize();
            let empty = set.directions.iter().all(|d| normal.dot(*d - a) < 1e-5);
            assert!(empty, "texel {i}: its triangle is not Delaunay");
        }
    }
}

/// Nearest sampling of the cube map disagrees with the nearest direction only where a cell's border crosses the texel.
#[test]
fn a_million_random_directions_disagree_only_in_texels_that_a_border_crosses() {
    let mut random = Random(3);
    let sets = sets();
    // Within a texel, directions are at most this far from its centre.
    let radius = (2f32.sqrt() / CUBE_SIZE as f32).atan();
    let mut disagreements = 0;
    for n in 0..1_000_000 {
        let set = &sets[1 + n % 4];
        let d = random_direction(&mut random);
        let (found, right) = (set.lookup(d)[0], nearest_direction(&set.directions, d));
        if found == right {
            continue;
        }
        disagreements += 1;
        let center = texel_direction(texel_of(d));
        assert!(
            center.angle_between(d) <= radius * 1.001,
            "the texel holds the direction"
        );
        // Nearer to one at the centre and to the other at the sample: their border runs between.
        let [a, b] = [found, right].map(|i| set.directions[i as usize]);
        assert!(center.dot(a) >= center.dot(b) && d.dot(b) >= d.dot(a));
    }
    println!("{disagreements} of a million directions read a neighbour's cell");
    assert!(disagreements < 150_000, "{disagreements}");
}

#[test]
fn ties_between_faces_follow_vulkan() {
    let face = |d: Vec3| texel_of(d) / (CUBE_SIZE * CUBE_SIZE) as usize;
    assert_eq!(face(Vec3::ONE), 4);
    assert_eq!(face(-Vec3::ONE), 5);
    assert_eq!(face(Vec3::new(1.0, 1.0, 0.0)), 2);
    assert_eq!(face(Vec3::new(1.0, -1.0, 0.0)), 3);
    assert_eq!(face(Vec3::X), 0);
    assert_eq!(face(Vec3::NEG_X), 1);
    assert!(texel_of(Vec3::ZERO) < (6 * CUBE_SIZE * CUBE_SIZE) as usize);
}
