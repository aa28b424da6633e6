//! What a scene's types do not say about its values.

use super::{AGENT_LIMIT, Area, Scene, SceneCrowd};

impl Scene {
    /// What the types do not say; the place and the reason where something is wrong.
    pub(super) fn check(&self) -> Result<(), (String, String)> {
        let require = |ok: bool, place: &str, reason: &str| {
            if ok {
                Ok(())
            } else {
                Err((place.to_string(), reason.to_string()))
            }
        };
        let positive = |x: f32| x.is_finite() && x > 0.0;
        require(
            positive(self.frames_per_second),
            "frames_per_second",
            "it is not a positive number",
        )?;
        require(
            positive(self.stand_in_scale),
            "stand_in_scale",
            "it is not a positive number",
        )?;
        require(
            self.ground_color
                .is_none_or(|c| c.is_finite() && c.min_element() >= 0.0 && c.max_element() <= 1.0),
            "ground_color",
            "a channel is not from 0 to 1",
        )?;
        for (i, c) in self.characters.iter().enumerate() {
            let place = format!("character {} '{}'", i + 1, c.name);
            require(
                !c.source.is_empty(),
                &place,
                "`source` names no file and no built-in character",
            )?;
            require(
                positive(c.share) && positive(c.scale) && c.height.is_none_or(positive),
                &place,
                "`share`, `scale` and `height` are not all positive numbers",
            )?;
        }
        require(
            !self.crowds.is_empty(),
            "crowd",
            "the scene has no [[crowd]]",
        )?;
        for (i, c) in self.crowds.iter().enumerate() {
            self.check_crowd(&format!("crowd {}", i + 1), c)?;
        }
        require(
            self.agent_count() <= AGENT_LIMIT,
            "crowd",
            "all crowds together have more than 10,000,000 agents",
        )?;
        for (i, c) in self.cameras.iter().enumerate() {
            let place = format!("camera {} '{}'", i + 1, c.name);
            require(
                c.name.is_empty() || self.cameras[..i].iter().all(|x| x.name != c.name),
                &place,
                "another camera has its `name`",
            )?;
            require(
                c.fov_y_deg > 0.0 && c.fov_y_deg < 180.0,
                &place,
                "`fov_y_deg` is not between 0 and 180",
            )?;
            require(
                c.path.len() != 1 && c.path.windows(2).all(|w| w[0].time < w[1].time),
                &place,
                "`path` needs two keys or more by rising time",
            )?;
            let views = c
                .path
                .iter()
                .map(|k| (k.position, k.target))
                .chain((c.path.is_empty()).then_some((c.position, c.target)));
            for (position, target) in views {
                require(
                    position.is_finite()
                        && target.is_finite()
                        && position.distance_squared(target) > 0.0,
                    &place,
                    "`position` and `target` are missing, the same, or not finite",
                )?;
            }
        }
        let l = &self.light;
        let colors = [l.sun_color, l.sky_color, l.ground_color];
        require(
            colors
                .iter()
                .all(|c| c.is_finite() && c.min_element() >= 0.0)
                && l.sun_azimuth_deg.is_finite()
                && l.sun_elevation_deg.is_finite(),
            "light",
            "a colour is negative, or a value is not finite",
        )
    }

    fn check_crowd(&self, place: &str, c: &SceneCrowd) -> Result<(), (String, String)> {
        let err = |reason: &str| Err((place.to_string(), reason.to_string()));
        match (c.count, &c.area, c.positions.is_empty()) {
            (Some(_), Some(_), true) | (None, None, false) => {}
            _ => return err("it needs either `count` and `area`, or `positions`"),
        }
        if c.positions.iter().any(|p| !p.is_finite()) {
            return err("a position is not finite");
        }
        let area_is_good = match c.area {
            Some(Area::Rectangle { center, size }) => {
                center.is_finite() && size.is_finite() && size.min_element() > 0.0
            }
            Some(Area::Ring {
                center,
                radius_min,
                radius_max,
            }) => {
                center.is_finite()
                    && radius_min >= 0.0
                    && radius_max > radius_min
                    && radius_max.is_finite()
            }
            Some(Area::Grid {
                center,
                spacing,
                columns,
            }) => {
                center.is_finite()
                    && spacing.is_finite()
                    && spacing.min_element() > 0.0
                    && columns > 0
            }
            Some(Area::Fan {
                center,
                heading_deg,
                angle_deg,
                radius_min,
                density,
            }) => {
                center.is_finite()
                    && heading_deg.is_finite()
                    && angle_deg > 0.0
                    && angle_deg < 180.0
                    && radius_min >= 0.0
                    && radius_min.is_finite()
                    && density > 0.0
                    && density.is_finite()
            }
            Some(Area::Rings {
                center,
                ring_spacing,
                spacing,
            }) => {
                // A ring has six agents at least, so that ten million agents are few enough rings to count.
                center.is_finite()
                    && ring_spacing > 0.0
                    && ring_spacing.is_finite()
                    && spacing > 0.0
                    && spacing <= ring_spacing
            }
            None => true,
        };
        if !area_is_good {
            return err("a number of its `area` is not finite, or a size is not positive");
        }
        for name in &c.characters {
            match self.characters.iter().filter(|x| x.name == *name).count() {
                1 => {}
                0 => return err(&format!("there is no character '{name}'")),
                n => {
                    return err(&format!(
                        "{n} characters are called '{name}': give each a `name` of its own"
                    ));
                }
            }
        }
        for clip in &c.clips {
            if !(clip.share > 0.0 && clip.share.is_finite())
                || clip.speed.is_some_and(|v| !(v >= 0.0 && v.is_finite()))
                || clip.time.is_some_and(|t| !t.is_finite())
            {
                return err(&format!(
                    "clip '{}': `share`, `speed` or `time` is negative, zero or not finite",
                    clip.name
                ));
            }
        }
        if c.heading_deg.is_some() && c.look_at.is_some() {
            return err("`heading_deg` and `look_at` exclude each other");
        }
        if c.heading_deg.is_some_and(|h| !h.is_finite())
            || c.look_at.is_some_and(|p| !p.is_finite())
            || !(0.0..1.0).contains(&c.size_spread)
        {
            return err(
                "`heading_deg` or `look_at` is not finite, or `size_spread` is not from 0 to 1",
            );
        }
        Ok(())
    }
}
