//! From some level on colours of vertices stand for textures.
//!
//! A triangle that has been stretched over a seam shows whatever lies between its corners' places in the texture. Where there
//! are few points, the mean colours of what their wedges stand for are nearer to the full mesh than a texture can be.

use crate::mesh::Mesh;

use super::Simplifier;
use super::coarse::PICTURE_POINTS;

/// Share of the points after which colours are tried again.
const TRY_SHARE: f64 = 0.9;
impl Simplifier<'_> {
    /// Gives all wedges colours of their own in place of textures once that looks no worse; at the latest at
    /// [`PICTURE_POINTS`].
    pub(super) fn leave_textures(&mut self) {
        let last = self.living_points <= PICTURE_POINTS && self.textures_tried != 0;
        if !self.refits()
            || !last && self.living_points as f64 > TRY_SHARE * self.textures_tried as f64
        {
            return;
        }
        let first = self.surface.mesh.vertex_count();
        let before = self.samples.contrast_total();
        let colored = self.color_wedges();
        self.textures_tried = if colored.is_empty() {
            0
        } else {
            self.living_points
        };
        if self.samples.contrast_total() <= before || last {
            for (old, new) in colored {
                self.step(old, new);
            }
            self.textures_tried = 0;
            self.dirty.fill(true);
            return;
        }
        for &(old, new) in &colored {
            let point = self.surface.point_of_wedge[old as usize];
            self.surface.replace_wedge(point, new, old);
        }
        self.surface.drop_wedges(first);
        self.look_everywhere();
    }

    /// A new wedge with a colour in the place of every textured one. Pairs of both.
    fn color_wedges(&mut self) -> Vec<(u32, u32)> {
        let mut fits = Vec::new();
        for point in 0..self.surface.wedges_of.len() as u32 {
            let s = &self.surface;
            for &wedge in &s.wedges_of[point as usize] {
                if s.mesh.layers[wedge as usize] != Mesh::UNTEXTURED {
                    fits.push((
                        point,
                        wedge,
                        self.samples.better_look(s, point, wedge, false),
                    ));
                }
            }
        }
        let mut colored = Vec::with_capacity(fits.len());
        for (point, wedge, fit) in fits {
            let shown = self.samples.looks().of(&self.surface.mesh, wedge).color;
            let s = &mut self.surface;
            let new = s.add_wedge(wedge);
            let (m, i) = (&mut s.mesh, new as usize);
            m.layers[i] = Mesh::UNTEXTURED;
            m.uvs[i] = glam::Vec2::ZERO;
            m.colors[i] = (shown * 255.0).round().to_array().map(|c| c as u8);
            if let Some(fit) = fit {
                m.colors[i] = fit.color;
                m.normals[i] = fit.normal;
                m.body_parts[i] = fit.body_part;
            }
            s.replace_wedge(point, wedge, new);
            colored.push((wedge, new));
        }
        if !colored.is_empty() {
            self.look_everywhere();
        }
        colored
    }

    fn look_everywhere(&mut self) {
        for point in 0..self.surface.wedges_of.len() as u32 {
            self.samples.look_again(&self.surface, point);
        }
    }
}
