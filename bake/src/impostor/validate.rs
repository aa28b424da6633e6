//! Checks impostors from an untrusted file: whatever passes can be uploaded and drawn.

use super::blocks::Blocks;
use super::groups::MAX_GROUPS;
use super::pack::MAX_ATLAS_SIZE;
use super::views::MAX_VIEWS;
use super::{Atlas, CUBE_TEXELS, Impostors, Kind, MAX_LEAN, NO_JOINT, ViewSet};
use crate::baked::Baked;

/// Most view sets.
const MAX_VIEW_SETS: usize = 16;
/// Most mips of the atlas.
const MAX_MIPS: u32 = 8;

/// Place and reason of the first rule that is broken.
pub(crate) fn validate(b: &Baked, i: &Impostors) -> Result<(), (String, String)> {
    atlas(&i.atlas)?;
    let sets = (1..=MAX_VIEW_SETS).contains(&i.view_sets.len());
    check(sets, || "view sets".into(), "there must be 1 to 16")?;
    for (n, set) in i.view_sets.iter().enumerate() {
        view_set(n, set)?;
    }
    let pose_count = poses(b, i)?;
    kinds(b, i, pose_count)?;
    tiles(i)
}

fn check(ok: bool, place: impl FnOnce() -> String, reason: &str) -> Result<(), (String, String)> {
    if ok {
        Ok(())
    } else {
        Err((format!("impostors, {}", place()), reason.into()))
    }
}

/// Whether an atlas has a size that the other checks, and memory, allow.
pub(super) fn size(a: &Atlas) -> Result<(), (String, String)> {
    let place = || "atlas".to_string();
    let mips = (1..=MAX_MIPS).contains(&a.mip_count);
    check(mips, place, "its mips are not from 1 to 8")?;
    let side =
        |n: u32| (1..=MAX_ATLAS_SIZE).contains(&n) && n.is_multiple_of(1 << (a.mip_count - 1));
    check(
        side(a.width) && side(a.height),
        place,
        "its size is not valid",
    )
}

fn atlas(a: &Atlas) -> Result<(), (String, String)> {
    size(a)?;
    let place = || "atlas".to_string();
    let texels = a.mip(a.mip_count).2;
    check(
        a.color.len() == texels && a.surface.len() == texels,
        place,
        "its pixels and its size differ",
    )?;
    let count = a.block_mip(a.mip_count).2;
    let whole = |b: &Blocks| b.color.len() == count && b.surface.len() == count;
    check(
        a.blocks.as_ref().is_none_or(whole),
        place,
        "its blocks and its size differ",
    )
}

fn view_set(n: usize, set: &ViewSet) -> Result<(), (String, String)> {
    let place = || format!("view set {n}");
    let count = (4..=MAX_VIEWS).contains(&set.directions.len());
    let shape = set.rights.len() == set.directions.len() && set.cells.len() == CUBE_TEXELS;
    check(
        count && shape,
        place,
        "its directions or its cube map are not whole",
    )?;
    let axes = set.directions.iter().zip(&set.rights).all(|(d, r)| {
        let unit = |v: glam::Vec3| (v.length() - 1.0).abs() < 1e-3;
        unit(*d) && unit(*r) && d.dot(*r).abs() < 1e-3
    });
    check(axes, place, "its axes are not unit vectors at right angles")?;
    let cells = set
        .cells
        .iter()
        .all(|c| c[..3].iter().all(|&v| (v as usize) < set.directions.len()));
    check(cells, place, "a cell names a direction that does not exist")
}

/// Poses of all clips.
fn poses(b: &Baked, i: &Impostors) -> Result<u32, (String, String)> {
    let has_quad = i.kinds.iter().any(|k| k.kind == Kind::Quad);
    let expected = if has_quad { b.clips.len() } else { 0 };
    let place = || "poses".to_string();
    check(
        i.clip_poses.len() == expected,
        place,
        "they are not those of the clips",
    )?;
    let mut next = 0u32;
    for (clip, range) in i.clip_poses.iter().enumerate() {
        let end = next.checked_add(range.pose_count);
        check(
            range.first_pose == next && range.pose_count > 0 && end.is_some(),
            || format!("poses of clip {clip}"),
            "they do not follow those of the clip before it",
        )?;
        next = end.unwrap_or(next);
    }
    Ok(next)
}

fn kinds(b: &Baked, i: &Impostors, pose_count: u32) -> Result<(), (String, String)> {
    let place = || "kinds".to_string();
    let rising = i.kinds.windows(2).all(|k| k[0].kind < k[1].kind);
    check(
        !i.kinds.is_empty() && rising,
        place,
        "there are none, or one is out of order",
    )?;
    let (mut next_quad, mut next_tile) = (0u64, 0u64);
    for k in &i.kinds {
        let place = || format!("kind {:?}", k.kind);
        let most = if k.kind == Kind::Quad {
            1
        } else {
            MAX_GROUPS as u32
        };
        let follows = u64::from(k.first_quad) == next_quad && (1..=most).contains(&k.quad_count);
        next_quad += u64::from(k.quad_count);
        check(
            follows && next_quad <= i.quads.len() as u64,
            place,
            "its quads do not exist",
        )?;
        let numbers = k.errors.iter().all(|e| {
            e.height_px.is_finite()
                && e.error_px.is_finite()
                && e.height_px >= 0.0
                && e.error_px >= 0.0
        });
        let rising = k.errors.windows(2).all(|e| e[0].height_px < e[1].height_px);
        check(
            numbers && rising,
            place,
            "its error curve is no curve of finite numbers",
        )?;
        for (n, q) in i
            .quads
            .iter()
            .enumerate()
            .take(next_quad as usize)
            .skip(k.first_quad as usize)
        {
            let place = || format!("quad {n} '{}'", q.name);
            let joint = match k.kind {
                Kind::Flat => (q.joint as usize) < b.joints.len(),
                Kind::Quad => q.joint == NO_JOINT,
            };
            check(joint, place, "its joint does not exist")?;
            let finite = q.center.is_finite() && q.depth_extent.is_finite() && q.depth_extent > 0.0;
            check(finite, place, "its centre or its depth is not valid")?;
            let Some(set) = i.view_sets.get(q.view_set as usize) else {
                return check(false, place, "its view set does not exist");
            };
            let poses = if k.kind == Kind::Quad { pose_count } else { 1 };
            check(
                u64::from(q.first_tile) == next_tile,
                place,
                "its tiles do not follow the quad before it",
            )?;
            next_tile += u64::from(poses) * set.directions.len() as u64;
            check(
                next_tile <= i.tiles.len() as u64,
                place,
                "its tiles do not exist",
            )?;
        }
    }
    let all = next_quad == i.quads.len() as u64 && next_tile == i.tiles.len() as u64;
    check(all, place, "quads or tiles belong to none")
}

fn tiles(i: &Impostors) -> Result<(), (String, String)> {
    let multiple = 1 << (i.atlas.mip_count - 1);
    for (n, t) in i.tiles.iter().enumerate() {
        let place = || format!("tile {n}");
        let finite = t.min.iter().chain(&t.max).all(|x| x.is_finite());
        let whole = (0..2).all(|k| t.min[k] <= t.max[k]) && (t.size[0] == 0) == (t.size[1] == 0);
        check(finite && whole, place, "its rectangle is not valid")?;
        let [x, y, z] = t.lean;
        let leans = x.hypot(y) <= 1.001 * MAX_LEAN && z.is_finite();
        check(leans, place, "its plane is not valid")?;
        let limit = [i.atlas.width, i.atlas.height];
        let inside = (0..2).all(|k| u32::from(t.texel[k]) + u32::from(t.size[k]) <= limit[k]);
        check(inside, place, "it lies outside the atlas")?;
        let aligned = t
            .texel
            .iter()
            .chain(&t.size)
            .all(|x| x.is_multiple_of(multiple));
        check(
            aligned,
            place,
            "it does not begin and end with a texel of every mip",
        )?;
    }
    Ok(())
}
