//! Materials as far as the tiles draw them: base colour, its texture, alpha, double-sidedness.
use super::error::{Fault, invalid, resolve};
use super::image::ImageTable;
use super::json::{self, Root, TextureInfo};
use super::{Filter, SourceAlpha, SourceMaterial, SourceTexture, Wrap};
use glam::{Affine2, Mat2, Vec2};

const NEAREST: u64 = 9728;
const LINEAR: u64 = 9729;
const REPEAT: u64 = 10497;
const CLAMP_TO_EDGE: u64 = 33071;
const MIRRORED_REPEAT: u64 = 33648;
const DEFAULT_ALPHA_CUTOFF: f64 = 0.5;

/// Which texture coordinates a material reads, and what to do to them.
pub(super) struct UvSource {
    pub set: u64,
    pub transform: Option<Affine2>,
}

/// The materials in glTF order, each with its source of texture coordinates if it has a texture.
pub(super) fn read_all(
    json: &Root,
    images: &mut ImageTable,
    warnings: &mut Vec<String>,
) -> Result<(Vec<SourceMaterial>, Vec<Option<UvSource>>), Fault> {
    let mut materials = Vec::with_capacity(json.materials.len());
    let mut uvs = Vec::with_capacity(json.materials.len());
    for (k, raw) in json.materials.iter().enumerate() {
        let place = format!("material {k}");
        let (factor, info) = base_color(raw);
        let texture = match info {
            Some(info) => Some(texture(json, info, images, &place, warnings)?),
            None => None,
        };
        uvs.push(info.map(|info| uv_source(info, &place)).transpose()?);
        materials.push(SourceMaterial {
            name: raw.name.clone(),
            base_color: unit_color(factor.unwrap_or([1.0; 4]), &place, warnings),
            texture,
            alpha: alpha(raw, &place)?,
            double_sided: raw.double_sided,
        });
    }
    Ok((materials, uvs))
}

/// The metallic-roughness base colour; where only specular-glossiness is given, its diffuse colour.
fn base_color(raw: &json::Material) -> (Option<[f64; 4]>, Option<&TextureInfo>) {
    let glossy = raw.extensions.as_ref().and_then(|e| e.specular_glossiness.as_ref());
    match (&raw.pbr_metallic_roughness, glossy) {
        (Some(pbr), _) if pbr.base_color_factor.is_some() || pbr.base_color_texture.is_some() => {
            (pbr.base_color_factor, pbr.base_color_texture.as_ref())
        }
        (_, Some(glossy)) => (glossy.diffuse_factor, glossy.diffuse_texture.as_ref()),
        _ => (None, None),
    }
}

fn unit_color(color: [f64; 4], place: &str, warnings: &mut Vec<String>) -> [f32; 4] {
    if color.iter().any(|c| !(0.0..=1.0).contains(c)) {
        warnings.push(format!("{place}: base colour {color:?} is clamped to 0 to 1"));
    }
    color.map(|c| c.clamp(0.0, 1.0) as f32)
}

fn alpha(raw: &json::Material, place: &str) -> Result<SourceAlpha, Fault> {
    match raw.alpha_mode.as_deref() {
        None | Some("OPAQUE") => Ok(SourceAlpha::Opaque),
        Some("BLEND") => Ok(SourceAlpha::Blend),
        Some("MASK") => {
            let cutoff = raw.alpha_cutoff.unwrap_or(DEFAULT_ALPHA_CUTOFF) as f32;
            if !cutoff.is_finite() || cutoff < 0.0 {
                return Err(invalid(place, format_args!("alphaCutoff {cutoff} is negative or not finite")));
            }
            Ok(SourceAlpha::Mask { cutoff })
        }
        Some(other) => Err(invalid(place, format_args!("alphaMode {other:?}, allowed are OPAQUE, MASK, BLEND"))),
    }
}

fn texture(
    json: &Root,
    info: &TextureInfo,
    images: &mut ImageTable,
    place: &str,
    warnings: &mut Vec<String>,
) -> Result<SourceTexture, Fault> {
    let (t, raw) = resolve(&json.textures, info.index.0, "texture", place)?;
    let place = format!("texture {t}");
    let image = match raw.source {
        Some(source) => images.index_of(resolve(&json.images, source.0, "image", &place)?.0),
        None => images.without_source(&place, warnings),
    };
    let sampler = match raw.sampler {
        Some(sampler) => Some(resolve(&json.samplers, sampler.0, "sampler", &place)?),
        None => None,
    };
    let Some((s, sampler)) = sampler else {
        return Ok(SourceTexture { image, wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, filter: Filter::Linear });
    };
    let place = format!("sampler {s}");
    let filter = match sampler.mag_filter.map_or(LINEAR, |f| f.0) {
        NEAREST => Filter::Nearest,
        LINEAR => Filter::Linear,
        other => {
            return Err(invalid(place, format_args!("magFilter {other} is not known")));
        }
    };
    let (wrap_u, wrap_v) = (wrap(sampler.wrap_s, &place)?, wrap(sampler.wrap_t, &place)?);
    Ok(SourceTexture { image, wrap_u, wrap_v, filter })
}

fn wrap(value: Option<json::Int>, place: &str) -> Result<Wrap, Fault> {
    match value.map_or(REPEAT, |v| v.0) {
        REPEAT => Ok(Wrap::Repeat),
        CLAMP_TO_EDGE => Ok(Wrap::Clamp),
        MIRRORED_REPEAT => Ok(Wrap::Mirror),
        other => Err(invalid(place, format_args!("wrap mode {other} is not known"))),
    }
}

/// `KHR_texture_transform`: scale, then rotate counterclockwise as seen with v downwards, then offset.
fn uv_source(info: &TextureInfo, place: &str) -> Result<UvSource, Fault> {
    let Some(raw) = info.extensions.as_ref().and_then(|e| e.transform.as_ref()) else {
        return Ok(UvSource { set: info.tex_coord.0, transform: None });
    };
    let vec2 =
        |value: Option<[f64; 2]>, default: f32| value.map_or(Vec2::splat(default), |v| Vec2::from_array(v.map(|c| c as f32)));
    // The sign is the one that Khronos' TextureTransformTest model asks for.
    let rotation = Mat2::from_angle(-(raw.rotation.unwrap_or(0.0) as f32));
    let transform = Affine2::from_mat2_translation(rotation * Mat2::from_diagonal(vec2(raw.scale, 1.0)), vec2(raw.offset, 0.0));
    if !transform.is_finite() {
        return Err(invalid(place, "KHR_texture_transform is not finite"));
    }
    Ok(UvSource { set: raw.tex_coord.unwrap_or(info.tex_coord).0, transform: Some(transform) })
}
