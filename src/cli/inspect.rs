//! `throng inspect`: what is in a baked character.

use std::mem::size_of;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use serde::Serialize;
use throng_bake::baked::{Baked, CollapseEntry, PaletteEntry, Vertex};
use throng_bake::impostor::groups::Groups;
use throng_bake::impostor::{self, ErrorSample, Kind};

use super::cache;
use super::impostors::Plan;
use super::output::{Progress, Table, grouped, say};
use super::picture::write_rgba;
use super::source::{self, Recipe};

/// Show a baked character: submeshes, levels of detail, clips, bytes
#[derive(clap::Args)]
#[command(
    long_about = "Shows what a baked character consists of: submeshes, the bands of its levels of detail with their \
                  error, joints, clips, impostors, and the bytes of each part. A source file or builtin:NAME is baked \
                  first.",
    after_help = "Examples:\n  throng inspect fox.throng\n  throng inspect fox.throng --json | jq .bytes_per_vertex\n  \
                  throng inspect fox.throng --atlas fox.png    the impostors' pictures, to fox.png and fox_surface.png\n  \
                  throng inspect fox.throng --joints           the names that fox.groups.toml may list"
)]
pub struct Arguments {
    /// A baked file, a source file, or builtin:NAME
    file: String,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Also list the joints: name, the joint above, and the group whose flat impostor shows it; --json always does
    #[arg(long)]
    joints: bool,
    /// Also write the impostors' pictures: colour with coverage as it is, and beside it, as OUT_surface.png, normals to the
    /// right and up in red and green and depth in blue
    #[arg(long, value_name = "OUT.png")]
    atlas: Option<PathBuf>,
    /// The axis that points up in a source file: OBJ files do not say it
    #[arg(long, value_name = "AXIS", default_value = "y")]
    up: source::Up,
    #[command(flatten)]
    cache: cache::Options,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let progress = Progress::default();
    let recipe = Recipe {
        impostors: Some(Plan::on(None)),
        cache: arguments.cache.open(),
        up: arguments.up,
        ..Recipe::default()
    };
    let baked = source::baked(&arguments.file, &recipe, &progress)?;
    if let Some(path) = &arguments.atlas {
        write_atlas(path, &baked, &arguments.file)?;
    }
    let mut contents = Contents::of(&baked);
    if arguments.json || arguments.joints {
        contents.joints = Some(Joint::all(&baked));
    }
    if arguments.json {
        say(serde_json::to_string_pretty(&contents)? + "\n")
    } else {
        say(contents)
    }
}

/// Writes the largest mip of the atlas's two pictures, turned so that characters stand upright.
fn write_atlas(path: &Path, baked: &Baked, source: &str) -> Result<()> {
    let Some(impostors) = &baked.impostors else {
        bail!("--atlas: {source} has no impostors");
    };
    let atlas = &impostors.atlas;
    let (width, height) = (atlas.width as usize, atlas.height as usize);
    let upright = |texel: &dyn Fn(usize) -> [u8; 4]| -> Vec<[u8; 4]> {
        let places = (0..width).flat_map(|x| (0..height).map(move |y| y * width + x));
        places.map(texel).collect()
    };
    // As pixels of a texel's size would show it.
    let coverage = |i: usize| (2 * i32::from(atlas.color[i][3]) - 128).clamp(0, 255) as u8;
    let color = upright(&|i| {
        let [r, g, b, _] = atlas.color[i];
        [r, g, b, coverage(i)]
    });
    write_rgba(path, &color, atlas.height)?;
    let surface = upright(&|i| {
        let [x, y, _, depth] = atlas.surface[i];
        [x, y, depth, if coverage(i) > 0 { 255 } else { 0 }]
    });
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push("_surface.png");
    write_rgba(&path.with_file_name(name), &surface, atlas.height)
}

/// What a baked character consists of. Errors are in bind-space units, metres for most characters.
#[derive(Serialize)]
pub struct Contents {
    pub name: String,
    pub vertex_count: u64,
    pub triangle_count: u64,
    pub submeshes: Vec<Submesh>,
    pub joint_count: usize,
    /// Only where they are asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<Joint>>,
    pub clips: Vec<Clip>,
    pub body_parts: Vec<String>,
    pub texture: Texture,
    pub error_max_m: f32,
    /// Absent where none were captured.
    pub impostors: Option<Impostors>,
    pub bytes: Bytes,
    pub bytes_per_vertex: BytesPerVertex,
}

#[derive(Serialize)]
pub struct Submesh {
    name: String,
    double_sided: bool,
    alpha_cutoff: Option<f32>,
    vertex_count: u32,
    bands: Vec<Band>,
}

/// A level that an index window is made for; levels between are drawn from the next finer one.
#[derive(Serialize)]
pub struct Band {
    vertex_count: u32,
    triangle_count: u32,
    error_m: f32,
}

/// A joint that vertices are bound to.
#[derive(Serialize)]
pub struct Joint {
    name: String,
    /// Name of the nearest joint above.
    parent: Option<String>,
    /// Name of the quad of the flat impostor that shows it. Absent without flat impostors; those of a sidecar file are only
    /// known for the joints that quads follow, because drawing needs no more.
    flat_group: Option<String>,
}

impl Joint {
    fn all(baked: &Baked) -> Vec<Self> {
        let name_of = |node: u32| baked.nodes[node as usize].name.clone();
        let flat_kind = |i: &impostor::Impostors| {
            let kind = i.kinds.iter().find(|k| k.kind == Kind::Flat)?;
            let quads = i.quads.iter().skip(kind.first_quad as usize);
            let quads = quads.take(kind.quad_count as usize);
            Some(quads.map(|q| (q.name.clone(), q.joint)).collect())
        };
        let quads: Vec<(String, u32)> = (baked.impostors.as_ref())
            .and_then(flat_kind)
            .unwrap_or_default();
        let by_rule = (!quads.is_empty()).then(|| Groups::by_rule(baked));
        // Names and drivers that agree mean that the file's groups are those by rule.
        let by_rule = by_rule.filter(|groups| {
            let groups = groups.groups.iter().map(|g| (&g.name, g.driver));
            groups.eq(quads.iter().map(|(name, joint)| (name, *joint)))
        });
        let flat_group = |joint: usize| match &by_rule {
            Some(groups) => Some(quads[groups.of_joint[joint] as usize].0.clone()),
            None => {
                let quad = quads.iter().find(|(_, driver)| *driver as usize == joint);
                quad.map(|(name, _)| name.clone())
            }
        };
        let parents = throng_bake::impostor::pose::joint_parents(&baked.nodes, &baked.joints);
        let joints = baked.joints.iter().zip(parents).enumerate();
        joints
            .map(|(i, (joint, parent))| Self {
                name: name_of(joint.node),
                parent: parent.map(|p| name_of(baked.joints[p].node)),
                flat_group: flat_group(i),
            })
            .collect()
    }
}

#[derive(Serialize)]
pub struct Clip {
    name: String,
    duration_s: f32,
    frame_count: u32,
    ground_speed_m_per_s: f32,
}

#[derive(Serialize)]
pub struct Texture {
    width_px: u32,
    height_px: u32,
    layer_count: u32,
}

/// Pictures for far agents.
#[derive(Serialize)]
pub struct Impostors {
    kinds: Vec<ImpostorKind>,
    tile_count: usize,
    atlas_width_px: u32,
    atlas_height_px: u32,
    mip_count: u32,
    /// Share of the atlas that tiles take.
    filled_share: f64,
}

/// A way to draw a character with quads.
#[derive(Serialize)]
pub struct ImpostorKind {
    kind: Kind,
    quads: Vec<ImpostorQuad>,
    /// Poses of all clips; 1 where quads follow joints.
    pose_count: u32,
    tile_count: usize,
    /// Pixel error of the mesh that is as far from the reference picture, by projected height.
    errors: Vec<ErrorSample>,
}

#[derive(Serialize)]
pub struct ImpostorQuad {
    name: String,
    view_count: usize,
}

impl Impostors {
    fn of(impostors: &impostor::Impostors) -> Self {
        let kinds = impostors.kinds.iter().map(|k| {
            let quads = impostors.quads.iter().skip(k.first_quad as usize);
            let quads: Vec<ImpostorQuad> = quads
                .take(k.quad_count as usize)
                .map(|q| ImpostorQuad {
                    name: q.name.clone(),
                    view_count: impostors.view_sets[q.view_set as usize].directions.len(),
                })
                .collect();
            let pose_count = match k.kind {
                Kind::Flat => 1,
                Kind::Quad => impostors.clip_poses.iter().map(|p| p.pose_count).sum(),
            };
            let views: usize = quads.iter().map(|q| q.view_count).sum();
            ImpostorKind {
                kind: k.kind,
                pose_count,
                tile_count: views * pose_count as usize,
                quads,
                errors: k.errors.clone(),
            }
        });
        let atlas = &impostors.atlas;
        let tiles = impostors.tiles.iter();
        let filled: f64 = tiles
            .map(|t| f64::from(t.size[0]) * f64::from(t.size[1]))
            .sum();
        Self {
            kinds: kinds.collect(),
            tile_count: impostors.tiles.len(),
            atlas_width_px: atlas.width,
            atlas_height_px: atlas.height,
            mip_count: atlas.mip_count,
            filled_share: filled / (f64::from(atlas.width) * f64::from(atlas.height)).max(1.0),
        }
    }
}

/// Bytes on the device and in the file.
#[derive(Serialize)]
pub struct Bytes {
    /// Position, normal, texture coordinate, colour, body part.
    geometry: u64,
    /// Joints and weights.
    skinning: u64,
    /// Parents and collapse errors.
    collapse: u64,
    /// Triangles of the finest band.
    triangles: u64,
    /// Triangles of all other bands, and the band table.
    bands: u64,
    /// Sampled clips.
    palette: u64,
    textures: u64,
    /// Both pictures of the impostors' atlas, all mips.
    impostors: u64,
    /// The whole file, with what only export needs.
    file: u64,
}

/// As Ramos et al. 2012, table 2, counts them: what one vertex costs.
#[derive(Serialize)]
pub struct BytesPerVertex {
    pub geometry: f64,
    pub skinning: f64,
    pub collapse: f64,
    pub triangles: f64,
    pub bands: f64,
    /// All of these together.
    pub total: f64,
    /// The same without skinning, which the paper does not count.
    pub total_without_skinning: f64,
}

impl Contents {
    /// Counts.
    pub fn of(baked: &Baked) -> Self {
        let submeshes: Vec<Submesh> = baked
            .submeshes
            .iter()
            .map(|s| Submesh {
                name: s.info.name.clone(),
                double_sided: s.info.double_sided,
                alpha_cutoff: s.info.alpha_cutoff,
                vertex_count: s.vertex_count,
                bands: baked
                    .bands
                    .iter()
                    .skip(s.first_band as usize)
                    .take(s.band_count as usize)
                    .map(|b| Band {
                        vertex_count: b.vertex_count,
                        triangle_count: b.index_count / 3,
                        error_m: b.error,
                    })
                    .collect(),
            })
            .collect();
        let finest = submeshes.iter().filter_map(|s| s.bands.first());
        let triangle_count: u64 = finest.map(|b| u64::from(b.triangle_count)).sum();
        let vertex_count = baked.vertices.len() as u64;
        let packed = |indices: &[u32]| throng_bake::indices::pack(indices).len() as u64;
        let skinning_bytes = (size_of::<[u8; 4]>() + size_of::<u32>()) as u64;
        let full = baked.submeshes.iter().filter_map(|s| {
            let band = baked.bands.get(s.first_band as usize)?;
            (baked.indices.get(band.first_index as usize..))?.get(..band.index_count as usize)
        });
        let triangles = full.map(packed).sum();
        let bytes = Bytes {
            geometry: vertex_count * (size_of::<Vertex>() as u64 - skinning_bytes),
            skinning: vertex_count * skinning_bytes,
            collapse: vertex_count * size_of::<CollapseEntry>() as u64,
            triangles,
            bands: packed(&baked.indices).saturating_sub(triangles)
                + size_of_val(&baked.bands[..]) as u64,
            palette: (baked.palette.len() * size_of::<PaletteEntry>()) as u64,
            textures: size_of_val(&baked.textures.pixels[..]) as u64,
            impostors: baked.impostors.as_ref().map_or(0, |i| {
                (size_of_val(&i.atlas.color[..]) + size_of_val(&i.atlas.surface[..])) as u64
            }),
            file: throng_bake::file::to_bytes(baked).len() as u64,
        };
        Self {
            name: baked.name.clone(),
            vertex_count,
            triangle_count,
            submeshes,
            joint_count: baked.joints.len(),
            joints: None,
            clips: baked
                .clips
                .iter()
                .map(|c| Clip {
                    name: c.name.clone(),
                    duration_s: c.duration_s,
                    frame_count: c.frame_count,
                    ground_speed_m_per_s: c.ground_speed,
                })
                .collect(),
            body_parts: baked.body_parts.iter().map(|b| b.name.clone()).collect(),
            texture: Texture {
                width_px: baked.textures.width,
                height_px: baked.textures.height,
                layer_count: baked.textures.layer_count,
            },
            error_max_m: baked.error_max,
            impostors: baked.impostors.as_ref().map(Impostors::of),
            bytes_per_vertex: bytes.per_vertex(vertex_count),
            bytes,
        }
    }
}

impl Bytes {
    fn per_vertex(&self, vertex_count: u64) -> BytesPerVertex {
        let each = |bytes: u64| bytes as f64 / vertex_count.max(1) as f64;
        let without_skinning = self.geometry + self.collapse + self.triangles + self.bands;
        BytesPerVertex {
            geometry: each(self.geometry),
            skinning: each(self.skinning),
            collapse: each(self.collapse),
            triangles: each(self.triangles),
            bands: each(self.bands),
            total: each(without_skinning + self.skinning),
            total_without_skinning: each(without_skinning),
        }
    }
}

impl std::fmt::Display for Contents {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{}: {} triangles, {} vertices, {} joints",
            self.name,
            grouped(self.triangle_count),
            grouped(self.vertex_count),
            self.joint_count
        )?;
        if self.texture.layer_count > 0 {
            let t = &self.texture;
            writeln!(
                f,
                "texture: {} layers of {}x{}",
                t.layer_count, t.width_px, t.height_px
            )?;
        }
        writeln!(f, "body parts: {}", self.body_parts.join(", "))?;
        for s in &self.submeshes {
            let sides = if s.double_sided { ", both sides" } else { "" };
            let alpha = match s.alpha_cutoff {
                Some(a) => format!(", cut out below alpha {a}"),
                None => String::new(),
            };
            writeln!(f, "\nsubmesh '{}'{sides}{alpha}", s.name)?;
            let mut table = Table::new(["band", "vertices", "triangles", "error m"]);
            for (i, b) in s.bands.iter().enumerate() {
                table.row([
                    i.to_string(),
                    grouped(b.vertex_count.into()),
                    grouped(b.triangle_count.into()),
                    format!("{:.5}", b.error_m),
                ]);
            }
            write!(f, "{table}")?;
        }
        writeln!(f)?;
        let mut table = Table::new(["clip", "seconds", "frames", "ground speed m/s"]);
        for c in &self.clips {
            table.row([
                c.name.clone(),
                format!("{:.2}", c.duration_s),
                c.frame_count.to_string(),
                format!("{:.2}", c.ground_speed_m_per_s),
            ]);
        }
        writeln!(f, "{table}")?;
        if let Some(joints) = &self.joints {
            // Names line up on their left, unlike numbers.
            let longest = |lengths: &mut dyn Iterator<Item = usize>| lengths.fold(11, usize::max);
            let length = |name: &String| name.chars().count();
            let joint = longest(&mut joints.iter().map(|j| length(&j.name)));
            let above = longest(&mut joints.iter().filter_map(|j| j.parent.as_ref().map(length)));
            let (head, above_head) = ("joint", "joint above");
            writeln!(f, "  {head:joint$}  {above_head:above$}  flat impostor")?;
            for j in joints {
                let [parent, group] =
                    [&j.parent, &j.flat_group].map(|n| n.as_deref().unwrap_or(""));
                let line = format!("  {:joint$}  {parent:above$}  {group}", j.name);
                writeln!(f, "{}", line.trim_end())?;
            }
            writeln!(f)?;
        }
        if let Some(impostors) = &self.impostors {
            writeln!(f, "{impostors}")?;
        }
        let (b, v) = (&self.bytes, &self.bytes_per_vertex);
        let mut table = Table::new(["part", "bytes", "per vertex"]);
        for (part, bytes, each) in [
            ("geometry", b.geometry, Some(v.geometry)),
            ("skinning", b.skinning, Some(v.skinning)),
            ("collapse texture", b.collapse, Some(v.collapse)),
            ("triangles", b.triangles, Some(v.triangles)),
            ("bands", b.bands, Some(v.bands)),
            (
                "mesh together",
                b.geometry + b.skinning + b.collapse + b.triangles + b.bands,
                Some(v.total),
            ),
            ("palette texture", b.palette, None),
            ("textures", b.textures, None),
            ("impostors", b.impostors, None),
            ("file", b.file, None),
        ] {
            table.row([
                part.to_string(),
                grouped(bytes),
                each.map_or_else(String::new, |x| format!("{x:.1}")),
            ]);
        }
        write!(f, "{table}")
    }
}

impl std::fmt::Display for Impostors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut table = Table::new(["impostors", "quads", "views", "poses", "tiles"]);
        for k in &self.kinds {
            let views = k.quads.iter().map(|q| q.view_count);
            let (least, most) = (views.clone().min(), views.max());
            table.row([
                format!("{:?}", k.kind).to_lowercase(),
                k.quads.len().to_string(),
                match (least, most) {
                    (Some(a), Some(b)) if a != b => format!("{a}-{b}"),
                    (Some(a), _) => a.to_string(),
                    _ => "0".into(),
                },
                k.pose_count.to_string(),
                grouped(k.tile_count as u64),
            ]);
        }
        write!(f, "{table}")?;
        writeln!(
            f,
            "  atlas: {} x {} texels, {} mips, {:.0} % filled",
            self.atlas_width_px,
            self.atlas_height_px,
            self.mip_count,
            100.0 * self.filled_share
        )?;
        let Some(first) = self.kinds.iter().find(|k| !k.errors.is_empty()) else {
            return Ok(());
        };
        write!(f, "  error in pixels at a height of")?;
        for sample in &first.errors {
            write!(f, " {:>5.0}", sample.height_px)?;
        }
        writeln!(f, " pixels")?;
        for k in self.kinds.iter().filter(|k| !k.errors.is_empty()) {
            write!(f, "  {:>31}", format!("{:?}", k.kind).to_lowercase())?;
            for sample in &k.errors {
                write!(f, " {:>5.2}", sample.error_px)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
