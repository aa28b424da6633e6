//! Materials and their images; only those that a primitive uses are read.

use glam::{Affine2, Vec2};
use serde::de::DeserializeOwned;

use super::data::Source;
use super::json::{Extensions, SpecularGlossiness, TextureInfo, TextureTransform};
use crate::character::{Alpha, Image, Material};
use crate::error::ImportError;
use crate::import::files;
use crate::import::images::{self, ImageFault};
use crate::import::surface::unblended;

/// Materials and images as they come into use.
#[derive(Default)]
pub struct Materials {
    pub materials: Vec<Material>,
    pub images: Vec<Image>,
    pub warnings: Vec<String>,
    /// By the file's material, `None` for the default one.
    known: Vec<(Option<usize>, Used)>,
    /// The file's image of each of `images`.
    known_images: Vec<usize>,
}

/// A material in use, and how its texture is looked up.
#[derive(Clone, Copy)]
pub struct Used {
    /// Index into [`Materials::materials`].
    pub index: u32,
    /// Which `TEXCOORD_n`.
    pub uv_set: u32,
    /// From the file's texture coordinates to those of the image.
    pub image_from_uv: Affine2,
}

impl Materials {
    /// The material of a primitive. Errors: it does not exist or is broken, or its image is.
    pub fn find(
        &mut self,
        source: &Source,
        material: Option<usize>,
        user: &str,
    ) -> Result<Used, ImportError> {
        if let Some((_, used)) = self.known.iter().find(|(m, _)| *m == material) {
            return Ok(*used);
        }
        let used = self.read(source, material, user)?;
        self.known.push((material, used));
        Ok(used)
    }

    fn read(
        &mut self,
        source: &Source,
        material: Option<usize>,
        user: &str,
    ) -> Result<Used, ImportError> {
        let mut used = Used {
            index: self.materials.len() as u32,
            uv_set: 0,
            image_from_uv: Affine2::IDENTITY,
        };
        let Some(i) = material else {
            self.materials.push(Material::default());
            return Ok(used);
        };
        let list = &source.document.materials;
        let given = source.get(list, i, "material", || format!("{user}.material"))?;
        let place = format!("materials[{i}]");
        let name = given
            .name
            .as_deref()
            .map_or_else(|| format!("material{i}"), |n| files::shorten(n, 1024));
        let pbr = &given.pbr_metallic_roughness;
        let (mut factor, mut texture) = (pbr.base_color_factor, pbr.base_color_texture.clone());
        let key = "KHR_materials_pbrSpecularGlossiness";
        let specular: Option<SpecularGlossiness> =
            extension(source, &given.extensions, key, &place)?;
        if let Some(specular) = specular
            && factor.is_none()
            && texture.is_none()
        {
            (factor, texture) = (specular.diffuse_factor, specular.diffuse_texture);
        }
        let mut factor = factor.unwrap_or([1.0; 4]);
        if factor.iter().any(|f| !f.is_finite()) {
            return Err(source.bad(place, "its colour is not finite"));
        }
        let base_color_image = match &texture {
            Some(texture) => {
                self.lookup(source, texture, &place, &mut used)?;
                self.image(source, texture.index, &place)?
            }
            None => None,
        };
        let alpha = match given.alpha_mode.as_deref() {
            None | Some("OPAQUE") => Alpha::Opaque,
            Some("MASK") => {
                Alpha::Mask(given.alpha_cutoff.filter(|c| c.is_finite()).unwrap_or(0.5))
            }
            Some("BLEND") => {
                let (alpha, warning) = unblended(&name, &mut factor, base_color_image.is_some());
                self.warnings.push(warning);
                alpha
            }
            Some(mode) => {
                let reason = format!("alphaMode '{}' does not exist", files::shorten(mode, 16));
                return Err(source.bad(place, reason));
            }
        };
        self.materials.push(Material {
            name,
            base_color: factor,
            base_color_image,
            alpha,
            double_sided: given.double_sided,
        });
        Ok(used)
    }

    /// Which coordinates `texture` is looked up with, and how they are transformed.
    fn lookup(
        &mut self,
        source: &Source,
        texture: &TextureInfo,
        place: &str,
        used: &mut Used,
    ) -> Result<(), ImportError> {
        used.uv_set = texture.tex_coord;
        let key = "KHR_texture_transform";
        let given: Option<TextureTransform> = extension(source, &texture.extensions, key, place)?;
        if let Some(given) = given {
            let offset = given.offset.map_or(Vec2::ZERO, Vec2::from);
            let scale = given.scale.map_or(Vec2::ONE, Vec2::from);
            // The extension's rotation runs the other way round: its v axis points down.
            let angle = -given.rotation.unwrap_or(0.0);
            used.image_from_uv = Affine2::from_scale_angle_translation(scale, 0.0, Vec2::ZERO);
            used.image_from_uv =
                Affine2::from_angle_translation(angle, offset) * used.image_from_uv;
            used.uv_set = given.tex_coord.unwrap_or(used.uv_set);
        }
        Ok(())
    }

    /// The index of the decoded image of `texture`; none where it states no image that is read here.
    fn image(
        &mut self,
        source: &Source,
        texture: usize,
        place: &str,
    ) -> Result<Option<u32>, ImportError> {
        let list = &source.document.textures;
        let Some(i) = source
            .get(list, texture, "texture", || place.into())?
            .source
        else {
            self.warnings.push(format!(
                "textures[{texture}] has no PNG or JPEG image; {place} is drawn without it"
            ));
            return Ok(None);
        };
        if let Some(known) = self.known_images.iter().position(|&k| k == i) {
            return Ok(Some(known as u32));
        }
        let list = &source.document.images;
        let place = || format!("textures[{texture}].source");
        let given = source.get(list, i, "image", place)?;
        let place = format!("images[{i}]");
        let read;
        let bytes = match (&given.uri, given.buffer_view) {
            (Some(uri), _) => {
                read = source.read_uri(uri, &place)?;
                &read[..]
            }
            (None, Some(view)) => source.view(view, &place)?.0,
            (None, None) => return Err(source.bad(place, "it has neither uri nor bufferView")),
        };
        let file_name = || {
            let uri = given.uri.as_deref().filter(|u| !u.starts_with("data:"))?;
            Some(files::shorten(uri, 1024))
        };
        let name = given.name.as_deref().map(|n| files::shorten(n, 1024));
        let name = name
            .or_else(file_name)
            .unwrap_or_else(|| format!("image{i}"));
        match images::decode(&name, bytes) {
            Ok(image) => self.images.push(image),
            Err(ImageFault::Content(reason)) => return Err(source.bad(place, reason)),
            Err(ImageFault::Format) => {
                return Err(ImportError::Unsupported {
                    path: source.path.to_path_buf(),
                    place: format!("{place} '{name}'"),
                    feature: "an image that is neither PNG nor JPEG".into(),
                    hint: "convert its textures to PNG".into(),
                });
            }
        }
        self.known_images.push(i);
        Ok(Some(self.images.len() as u32 - 1))
    }
}

/// The extension `key` where it is there. Errors: it is broken.
fn extension<T: DeserializeOwned>(
    source: &Source,
    extensions: &Extensions,
    key: &str,
    place: &str,
) -> Result<Option<T>, ImportError> {
    extensions
        .get(key)
        .map(|value| {
            serde_path_to_error::deserialize(value).map_err(|e| {
                let place = format!("{place}.extensions.{key}.{}", e.path());
                source.bad(place, e.inner().to_string())
            })
        })
        .transpose()
}
