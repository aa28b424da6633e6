//! Checks a baked character from an untrusted file: whatever passes can be uploaded and drawn.

use crate::baked::Baked;
use crate::character::Interpolation;
use crate::mesh::Mesh;
use crate::texture;

/// Most palette joints: `Vertex::joints` are bytes.
pub const MAX_JOINTS: usize = 256;
/// Largest side of a texture layer.
const MAX_TEXTURE_SIZE: u32 = 16_384;

/// Place and reason of the first rule that is broken.
pub fn validate(b: &Baked) -> Result<(), (String, String)> {
    submeshes(b)?;
    vertices(b)?;
    animation(b)?;
    skeleton(b)?;
    textures(b)?;
    b.impostors
        .as_ref()
        .map_or(Ok(()), |i| crate::impostor::validate::validate(b, i))
}

fn check(ok: bool, place: impl FnOnce() -> String, reason: &str) -> Result<(), (String, String)> {
    if ok {
        Ok(())
    } else {
        Err((place(), reason.into()))
    }
}

fn submeshes(b: &Baked) -> Result<(), (String, String)> {
    check(
        !b.submeshes.is_empty() && b.submeshes.len() <= 255,
        || "submeshes".into(),
        "there must be 1 to 255",
    )?;
    check(
        b.collapse.len() == b.vertices.len(),
        || "COLL".into(),
        "it differs from the vertices in number",
    )?;
    let (mut next_vertex, mut next_band) = (0u32, 0u32);
    for (i, s) in b.submeshes.iter().enumerate() {
        let place = || format!("submesh {i}");
        let cutoff = s.info.alpha_cutoff.is_none_or(|c| c.is_finite());
        check(cutoff, place, "its alpha cutoff is not finite")?;
        check(
            s.first_vertex == next_vertex && s.first_band == next_band,
            place,
            "it does not follow the one before it",
        )?;
        let vertices = (s.first_vertex as u64 + s.vertex_count as u64) <= b.vertices.len() as u64;
        let bands = (s.first_band as u64 + s.band_count as u64) <= b.bands.len() as u64;
        check(
            vertices && s.vertex_count > 0,
            place,
            "its vertices do not exist",
        )?;
        check(bands && s.band_count > 0, place, "its bands do not exist")?;
        (next_vertex, next_band) = (next_vertex + s.vertex_count, next_band + s.band_count);
        let collapse = &b.collapse[s.first_vertex as usize..next_vertex as usize];
        let mut above = f32::INFINITY;
        for (v, c) in collapse.iter().enumerate() {
            let parent = if c.error == f32::INFINITY {
                c.parent as usize == v
            } else {
                (c.parent as usize) < v
            };
            check(
                parent,
                || format!("submesh {i}, vertex {v}"),
                "its collapse target is not a vertex before it",
            )?;
            check(
                c.error >= 0.0 && c.error <= above,
                || format!("submesh {i}, vertex {v}"),
                "its collapse error rises or is no number",
            )?;
            above = c.error;
        }
        check(
            collapse[0].error == f32::INFINITY,
            place,
            "its first vertex dies",
        )?;
        let mut live = u32::MAX;
        for (k, band) in b.bands[s.first_band as usize..next_band as usize]
            .iter()
            .enumerate()
        {
            let place = || format!("submesh {i}, band {k}");
            let full = k > 0 || band.vertex_count == s.vertex_count;
            let falls = band.vertex_count > 0 && band.vertex_count < live && full;
            check(
                falls,
                place,
                "its live vertices do not fall from all of them",
            )?;
            check(
                band.error.is_finite() && band.error >= 0.0,
                place,
                "its error is not finite",
            )?;
            let end = band.first_index as u64 + band.index_count as u64;
            check(
                band.index_count % 3 == 0 && end <= b.indices.len() as u64,
                place,
                "its indices do not exist",
            )?;
            let window = &b.indices[band.first_index as usize..end as usize];
            check(
                window.iter().all(|&v| v < s.vertex_count),
                place,
                "an index names a vertex that does not exist",
            )?;
            live = band.vertex_count;
        }
    }
    let all = next_vertex as usize == b.vertices.len() && next_band as usize == b.bands.len();
    check(
        all,
        || "submeshes".into(),
        "vertices or bands belong to none",
    )
}

fn vertices(b: &Baked) -> Result<(), (String, String)> {
    let finite = b.position_min.is_finite()
        && b.position_extent.is_finite()
        && b.uv_min.is_finite()
        && b.uv_extent.is_finite();
    check(
        finite && b.error_max.is_finite(),
        || "META".into(),
        "an extent is not finite",
    )?;
    for (i, v) in b.vertices.iter().enumerate() {
        let place = || format!("vertex {i}");
        check(
            v.joints.iter().all(|&j| (j as usize) < b.joints.len()),
            place,
            "it names a joint that does not exist",
        )?;
        check(
            (v.body_part as usize) < b.body_parts.len(),
            place,
            "it names a body part that does not exist",
        )?;
        let layer = v.layer == Mesh::UNTEXTURED || (v.layer as u32) < b.textures.layer_count;
        check(layer, place, "it names a texture layer that does not exist")?;
    }
    Ok(())
}

fn animation(b: &Baked) -> Result<(), (String, String)> {
    check(!b.clips.is_empty(), || "clips".into(), "there are none")?;
    let mut next = 0u64;
    for (i, c) in b.clips.iter().enumerate() {
        let place = || format!("clip {i} '{}'", c.name);
        check(
            c.first_frame as u64 == next && c.frame_count > 0,
            place,
            "its frames do not follow the clip before it",
        )?;
        next += c.frame_count as u64;
        let numbers = [c.duration_s, c.ground_speed, c.sphere_radius, c.ground]
            .iter()
            .all(|x| x.is_finite());
        let bounds = c.box_min.is_finite() && c.box_max.is_finite() && c.sphere_center.is_finite();
        check(
            numbers && bounds && c.duration_s >= 0.0 && c.sphere_radius >= 0.0,
            place,
            "its duration or bounds are no finite numbers",
        )?;
    }
    let entries = next.checked_mul(b.joints.len() as u64);
    check(
        entries == Some(b.palette.len() as u64),
        || "PALT".into(),
        "its length is not frames times joints",
    )?;
    let finite = bytemuck::cast_slice::<_, f32>(&b.palette)
        .iter()
        .all(|x| x.is_finite());
    check(finite, || "PALT".into(), "a number is not finite")
}

fn skeleton(b: &Baked) -> Result<(), (String, String)> {
    check(
        !b.joints.is_empty() && b.joints.len() <= MAX_JOINTS,
        || "joints".into(),
        "there must be 1 to 256",
    )?;
    for (i, n) in b.nodes.iter().enumerate() {
        let r = &n.rest;
        let finite = r.translation.is_finite() && r.rotation.is_finite() && r.scale.is_finite();
        check(
            n.parent.is_none_or(|p| (p as usize) < i) && finite,
            || format!("node {i}"),
            "its parent or its transform is not valid",
        )?;
    }
    for (i, j) in b.joints.iter().enumerate() {
        let ok = (j.node as usize) < b.nodes.len() && j.joint_from_bind.is_finite();
        check(
            ok,
            || format!("joint {i}"),
            "its node does not exist or its matrix is not finite",
        )?;
    }
    for c in &b.source_clips {
        let place = || format!("source clip '{}'", c.name);
        check(
            c.duration_s.is_finite() && c.duration_s >= 0.0,
            place,
            "its duration is not a finite time",
        )?;
        for t in &c.tracks {
            let width = t.property.width()
                * if t.interpolation == Interpolation::CubicSpline {
                    3
                } else {
                    1
                };
            let shape = !t.times_s.is_empty() && t.values.len() == t.times_s.len() * width;
            check(
                (t.node as usize) < b.nodes.len() && shape,
                place,
                "a track's node or keys do not exist",
            )?;
            let finite = t.times_s.iter().chain(&t.values).all(|x| x.is_finite());
            check(
                finite && t.times_s.is_sorted(),
                place,
                "a track's keys are not finite or its times fall",
            )?;
        }
    }
    Ok(())
}

fn textures(b: &Baked) -> Result<(), (String, String)> {
    let t = &b.textures;
    let size = t.width <= MAX_TEXTURE_SIZE
        && t.height <= MAX_TEXTURE_SIZE
        && t.layer_count < Mesh::UNTEXTURED as u32;
    let whole = t.layer_count == 0
        || (t.width > 0
            && t.height > 0
            && t.mip_count == 32 - t.width.max(t.height).leading_zeros());
    check(
        size && whole,
        || "TEXR".into(),
        "its size or its mips are not valid",
    )?;
    let pixels = if t.layer_count == 0 {
        0
    } else {
        texture::pixel_count(t.width, t.height, t.layer_count, t.mip_count)
    };
    check(
        t.pixels.len() as u64 == pixels,
        || "TEXR".into(),
        "its pixels and its size differ",
    )
}
