//! Wavefront OBJ through `tobj`: a static character with one joint and no clips.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use glam::{Mat4, Vec2, Vec3};
use tobj::{LoadError, LoadOptions};

use super::images::ImageFault;
use super::surface::{Influences, Surface, unblended};
use super::{files, images, influences};
use crate::character::{Alpha, Character, Image, Joint, Material, Node, Transform};
use crate::error::ImportError;

/// Triangles with one index for all attributes; points and lines are left out.
const OPTIONS: LoadOptions = LoadOptions {
    single_index: true,
    triangulate: true,
    ignore_points: true,
    ignore_lines: true,
};

/// Reads an OBJ file and the material library and textures that it names.
///
/// A library or texture that is missing is a warning; one that is there and broken is an error.
pub(super) fn import(path: &Path, bytes: &[u8]) -> Result<Character, ImportError> {
    // Old exporters write names and comments in any encoding.
    let text = String::from_utf8_lossy(bytes);
    let library = RefCell::new(Library {
        path,
        folder: path.to_path_buf(),
        warnings: Vec::new(),
        error: None,
    });
    let read_library = |name: &Path| library.borrow_mut().read(name);
    let loaded = tobj::load_obj_buf(&mut text.as_bytes(), &OPTIONS, read_library);
    let mut library = library.into_inner();
    if let Some(error) = library.error.take() {
        return Err(error);
    }
    let (models, materials) = loaded.map_err(|error| {
        let place = format!("line {}", failing_line(&text));
        ImportError::malformed(path, place, error.to_string())
    })?;
    let materials = materials.unwrap_or_default();
    let mut character = Character {
        nodes: vec![Node {
            name: "root".into(),
            parent: None,
            rest: Transform::IDENTITY,
        }],
        joints: vec![Joint {
            node: 0,
            joint_from_bind: Mat4::IDENTITY,
        }],
        ..Character::default()
    };
    let mut textures = Textures::default();
    for material in &materials {
        let material = textures.material(&mut library, material)?;
        character.materials.push(material);
    }
    let mut default_material = None;
    let mut part_influences = Vec::new();
    for model in models {
        let name = files::shorten(&model.name, 1024);
        let mut surface = surface(path, name, &model.mesh)?;
        surface.drop_degenerate();
        surface.drop_unused();
        if surface.triangles.is_empty() {
            continue;
        }
        surface.material = match model.mesh.material_id {
            Some(m) if m < materials.len() => m as u32,
            _ => *default_material.get_or_insert_with(|| {
                character.materials.push(Material::default());
                character.materials.len() as u32 - 1
            }),
        };
        surface.complete_normals();
        let (part, influences) = surface.into_part();
        character.parts.push(part);
        part_influences.push(influences);
    }
    character.images = textures.images;
    character.warnings = library.warnings;
    influences::reduce(&mut character, &part_influences);
    Ok(character)
}

/// The first line (from 1) with which the text up to there no longer loads.
fn failing_line(text: &str) -> usize {
    let ends: Vec<usize> = text.match_indices('\n').map(|(i, _)| i + 1).collect();
    let loads = |&end: &usize| {
        let no_library = |_: &Path| Ok(Default::default());
        tobj::load_obj_buf(&mut &text.as_bytes()[..end], &OPTIONS, no_library).is_ok()
    };
    ends.partition_point(loads) + 1
}

/// The triangles of one model, bound to the one joint.
fn surface(path: &Path, name: String, mesh: &tobj::Mesh) -> Result<Surface, ImportError> {
    let bad = |reason: &str| {
        let place = format!("object '{name}'");
        ImportError::malformed(path, place, reason)
    };
    let vec3 = |values: &[f32]| values.chunks_exact(3).map(Vec3::from_slice).collect();
    let positions: Vec<Vec3> = vec3(&mesh.positions);
    let vertex_count = positions.len();
    if mesh.indices.iter().any(|&v| v as usize >= vertex_count)
        || !mesh.indices.len().is_multiple_of(3)
    {
        return Err(bad("a face names a vertex that does not exist"));
    }
    if !positions.iter().all(|p| p.is_finite()) {
        return Err(bad("a position is infinite or not a number"));
    }
    let mut normals: Vec<Vec3> = vec3(&mesh.normals);
    if normals.len() != vertex_count || !normals.iter().all(|n| n.is_finite()) {
        normals.clear();
    }
    // OBJ counts v from the bottom of the image.
    let mut uvs: Vec<Vec2> = mesh
        .texcoords
        .chunks_exact(2)
        .map(Vec2::from_slice)
        .collect();
    if uvs.len() != vertex_count || !uvs.iter().all(|uv| uv.is_finite()) {
        uvs.clear();
    }
    for uv in &mut uvs {
        uv.y = 1.0 - uv.y;
    }
    let mut colors: Vec<[f32; 4]> = Vec::new();
    if mesh.vertex_color.len() == 3 * vertex_count
        && mesh.vertex_color.iter().all(|c| c.is_finite())
    {
        let full = |c: &[f32]| [c[0], c[1], c[2], 1.0];
        colors = mesh.vertex_color.chunks_exact(3).map(full).collect();
    }
    Ok(Surface {
        name,
        material: 0,
        positions,
        normals,
        uvs,
        colors,
        influences: Influences {
            width: 1,
            of_vertices: vec![(0, 1.0); vertex_count],
        },
        triangles: mesh
            .indices
            .chunks_exact(3)
            .map(|t| [t[0], t[1], t[2]])
            .collect(),
    })
}

/// Reads material libraries while `tobj` parses, and keeps what is to be told about it.
struct Library<'a> {
    /// The OBJ file.
    path: &'a Path,
    /// The library that was read last: textures lie beside it.
    folder: PathBuf,
    warnings: Vec<String>,
    error: Option<ImportError>,
}

impl Library<'_> {
    fn read(&mut self, name: &Path) -> tobj::MTLLoadResult {
        let name = name.to_string_lossy();
        let Some(file) = find(self.path, &name) else {
            self.warnings.push(format!(
                "the material library '{}' is missing; its materials are drawn white",
                files::shorten(&name, 80)
            ));
            return Err(LoadError::OpenFileFailed);
        };
        let bytes = match files::read(&file) {
            Ok(bytes) => bytes,
            Err(error) => {
                self.error.get_or_insert(error);
                return Err(LoadError::ReadError);
            }
        };
        let text = String::from_utf8_lossy(&bytes);
        let loaded = tobj::load_mtl_buf(&mut text.as_bytes());
        if let Err(error) = &loaded {
            self.error.get_or_insert(ImportError::malformed(
                &file,
                "material library",
                error.to_string(),
            ));
        }
        self.folder = file;
        loaded
    }
}

/// The file that `name` means beside `path`, if it is there: OBJ files often keep the absolute path of somebody's disk,
/// then its last component counts.
fn find(path: &Path, name: &str) -> Option<PathBuf> {
    // A percent sign is one in OBJ; only `resolve` reads it as an escape.
    let literal = |name: &str| files::resolve(path, &name.replace('%', "%25")).ok();
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    [literal(name), literal(last)]
        .into_iter()
        .flatten()
        .find(|file| file.is_file())
}

/// Images by the name that the library gives them.
#[derive(Default)]
struct Textures {
    images: Vec<Image>,
    known: Vec<(String, Option<u32>)>,
}

impl Textures {
    fn material(
        &mut self,
        library: &mut Library,
        given: &tobj::Material,
    ) -> Result<Material, ImportError> {
        let name = files::shorten(&given.name, 1024);
        let [r, g, b] = given.diffuse.unwrap_or([1.0; 3]);
        let dissolve = given.dissolve.unwrap_or(1.0);
        let mut base_color = [r, g, b, dissolve];
        if !base_color.iter().all(|c| c.is_finite()) {
            let reason = "its colour is not finite";
            return Err(ImportError::malformed(
                &library.folder,
                format!("material '{name}'"),
                reason,
            ));
        }
        let base_color_image = match &given.diffuse_texture {
            Some(texture) => self.image(library, texture)?,
            None => None,
        };
        // Exporters that mean "the texture alone" leave black behind.
        if base_color_image.is_some() && base_color[..3] == [0.0; 3] {
            base_color[..3].fill(1.0);
        }
        let cut_out =
            given.dissolve_texture.is_some() && given.dissolve_texture == given.diffuse_texture;
        let mut alpha = Alpha::Opaque;
        if cut_out {
            alpha = Alpha::Mask(0.5);
        }
        if dissolve < 1.0 {
            let (how, warning) = unblended(&name, &mut base_color, cut_out);
            alpha = how;
            library.warnings.push(warning);
        } else if given.dissolve_texture.is_some() && !cut_out {
            library.warnings.push(format!(
                "material '{name}' has a transparency texture of its own; it is left out"
            ));
        }
        Ok(Material {
            name,
            base_color,
            base_color_image,
            alpha,
            double_sided: false,
        })
    }

    /// The image of a `map_Kd` line, whose options are skipped; none with a warning where the file is missing.
    fn image(&mut self, library: &mut Library, line: &str) -> Result<Option<u32>, ImportError> {
        let name = if line.starts_with('-') {
            line.rsplit(char::is_whitespace).next().unwrap_or(line)
        } else {
            line
        };
        if let Some((_, index)) = self.known.iter().find(|(known, _)| known == name) {
            return Ok(*index);
        }
        let index = match find(&library.folder, name) {
            None => {
                library.warnings.push(format!(
                    "the texture '{}' is missing; its material is drawn without it",
                    files::shorten(name, 80)
                ));
                None
            }
            Some(file) => {
                let place = format!("image '{}'", files::shorten(name, 80));
                match images::decode(name, &files::read(&file)?) {
                    Ok(image) => self.images.push(image),
                    Err(ImageFault::Content(reason)) => {
                        return Err(ImportError::malformed(&file, place, reason));
                    }
                    Err(ImageFault::Format) => {
                        library.warnings.push(format!(
                            "the texture '{}' is neither PNG nor JPEG; its material is drawn without it",
                            files::shorten(name, 80)
                        ));
                        self.known.push((name.to_string(), None));
                        return Ok(None);
                    }
                }
                Some(self.images.len() as u32 - 1)
            }
        };
        self.known.push((name.to_string(), index));
        Ok(index)
    }
}
