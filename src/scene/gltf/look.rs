//! Materials: what of glTF's the rasteriser has. Base colour and its texture, alpha, roughness and metalness (the mean where
//! a texture has them), emission as a factor on the base colour, unlit. Normal and occlusion maps are left out.

use super::{data::Data, shape::TextureMatrix};
use crate::{
    image::Image,
    metrics::srgb,
    scene::{
        model::{Alpha, Material, Scene},
        texture::Mips,
    },
};
use glam::{Mat3, Vec2};
use gltf::material::AlphaMode;
use std::collections::HashMap;

/// Materials and textures of a file, added to a scene when they are first needed.
#[derive(Default)]
pub struct Looks {
    materials: HashMap<Option<usize>, usize>,
    textures: HashMap<usize, usize>,
}

impl Looks {
    /// The scene's material for one of the file's.
    pub fn material(&mut self, data: &Data, scene: &mut Scene, of: &gltf::Material<'_>) -> Result<usize, String> {
        if let Some(known) = self.materials.get(&of.index()) {
            return Ok(*known);
        }
        let material = self.translate(data, scene, of)?;
        let index = scene.material(material);
        self.materials.insert(of.index(), index);
        Ok(index)
    }

    fn translate(&mut self, data: &Data, scene: &mut Scene, of: &gltf::Material<'_>) -> Result<Material, String> {
        let surface = of.pbr_metallic_roughness();
        let [red, green, blue, opacity] = surface.base_color_factor();
        let texture = match surface.base_color_texture() {
            Some(info) => Some(self.texture(data, scene, info.texture().source().index())?),
            None => None,
        };
        // Green is roughness, blue metalness.
        let means = match surface.metallic_roughness_texture() {
            Some(info) => mean(&data.image(info.texture().source().index())?),
            None => [1.0; 4],
        };
        let (alpha, scale) = match of.alpha_mode() {
            AlphaMode::Opaque => (Alpha::Opaque, 1.0),
            // Holes begin below one half here.
            AlphaMode::Mask => (Alpha::Cut, 0.5 / of.alpha_cutoff().unwrap_or(0.5).max(1e-3)),
            AlphaMode::Blend => (Alpha::Blended, 1.0),
        };
        let strength = of.emissive_strength().unwrap_or(1.0);
        let emissive = of.emissive_factor().map(|c| c * strength);
        let is_unlit = of.unlit();
        Ok(Material {
            color: [red, green, blue],
            opacity: opacity * scale,
            texture,
            alpha,
            emissive: if is_unlit { [1.0; 3] } else { emissive },
            lit: !is_unlit,
            // At 0 the highlight is a point that no sample meets.
            roughness: Some((surface.roughness_factor() * means[1]).clamp(0.05, 1.0)),
            metallic: (surface.metallic_factor() * means[2]).clamp(0.0, 1.0),
            reactive: if alpha == Alpha::Blended { 1.0 } else { 0.0 },
            two_sided: of.double_sided(),
            casts_shadow: alpha != Alpha::Blended,
            ..Material::default()
        })
    }

    fn texture(&mut self, data: &Data, scene: &mut Scene, image: usize) -> Result<usize, String> {
        if let Some(known) = self.textures.get(&image) {
            return Ok(*known);
        }
        let decoded: [f32; 256] = std::array::from_fn(|code| srgb::decode(code as f64 / 255.0) as f32);
        let linear = data.image(image)?.map(|[r, g, b, a]| {
            let [r, g, b] = [r, g, b].map(|code| decoded[usize::from(code)]);
            [r, g, b, f32::from(a) / 255.0]
        });
        let index = scene.texture(Mips::new(linear));
        self.textures.insert(image, index);
        Ok(index)
    }
}

/// Which texture coordinates a material's base colour reads, and how they are moved first.
pub fn texture_coordinates(of: &gltf::Material<'_>) -> (u32, TextureMatrix) {
    let Some(info) = of.pbr_metallic_roughness().base_color_texture() else {
        return (0, Mat3::IDENTITY);
    };
    match info.texture_transform() {
        None => (info.tex_coord(), Mat3::IDENTITY),
        Some(transform) => (
            transform.tex_coord().unwrap_or(info.tex_coord()),
            // Counter-clockwise as seen, as the extension says in words; v runs down, which turns the angle's sense.
            Mat3::from_scale_angle_translation(
                Vec2::from(transform.scale()),
                -transform.rotation(),
                Vec2::from(transform.offset()),
            ),
        ),
    }
}

/// Of the texels as stored, in 0 to 1.
fn mean(image: &Image<[u8; 4]>) -> [f32; 4] {
    let sum = image.pixels().iter().fold([0.0; 4], |sum: [f64; 4], texel| {
        std::array::from_fn(|i| sum[i] + f64::from(texel[i]))
    });
    sum.map(|c| (c / (255.0 * image.pixels().len() as f64)) as f32)
}
