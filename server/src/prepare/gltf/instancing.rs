//! `EXT_mesh_gpu_instancing`: a node drawn once per element of its TRANSLATION, ROTATION, SCALE arrays.
use super::accessor::{Accessor, Component, Shape};
use super::error::{Fault, invalid, over_cap};
use super::json::Instancing;
use super::validate::Asset;
use glam::{DAffine3, DQuat, DVec3};

/// Most instances that all nodes of one file may have together.
pub const MAX_INSTANCES: u64 = 1 << 24;

/// Most instances of a node none of whose attributes has a buffer view: they cost the file nothing, and their places are
/// all the same but for sparse ones.
pub const MAX_ZERO_FILLED_INSTANCES: usize = 1 << 16;

/// What an instance costs in preparation at its peak, in bytes: its transform here (96), its place (224), its transform and
/// leaf in the manifest (148), its node in the hierarchy (152), its object with its range of leaves (200).
const INSTANCE_BYTES: usize = 832;

/// `local_from_instance` of each instance; `left` is what remains of [`MAX_INSTANCES`].
pub(super) fn read(asset: &Asset, raw: &Instancing, node: &str, left: &mut u64) -> Result<Vec<DAffine3>, Fault> {
    let place = format!("{node} EXT_mesh_gpu_instancing");
    let attribute = |name: &str, shape: Shape| -> Result<Option<Accessor>, Fault> {
        let Some(index) = raw.attributes.get(name) else {
            return Ok(None);
        };
        let accessor = Accessor::resolve(asset, index.0, &place)?;
        let typed = match accessor.component {
            Component::F32 => true,
            Component::I8 | Component::I16 => accessor.normalized,
            _ => false,
        };
        if accessor.shape != shape || !typed {
            return Err(invalid(
                accessor.place(),
                format_args!("{name} must be {shape:?} of floats or normalized signed integers"),
            ));
        }
        Ok(Some(accessor))
    };
    let translation = attribute("TRANSLATION", Shape::Vec3)?;
    let rotation = attribute("ROTATION", Shape::Vec4)?;
    let scale = attribute("SCALE", Shape::Vec3)?;

    let counts = || [&translation, &rotation, &scale].into_iter().flatten().map(|a| a.count);
    let Some(count) = counts().next() else {
        return Ok(Vec::new());
    };
    if counts().any(|other| other != count) {
        return Err(invalid(place, "its attributes differ in count"));
    }
    let zero_filled = [&translation, &rotation, &scale].into_iter().flatten().all(Accessor::is_zero_filled);
    if zero_filled && count > MAX_ZERO_FILLED_INSTANCES {
        let reason = format!("{count} instances without a bufferView");
        return Err(over_cap(place, reason, "MAX_ZERO_FILLED_INSTANCES", MAX_ZERO_FILLED_INSTANCES as u64));
    }
    *left = left
        .checked_sub(count as u64)
        .ok_or_else(|| over_cap(&place, format_args!("{count} more instances"), "MAX_INSTANCES", MAX_INSTANCES))?;
    asset.budget.take(count, INSTANCE_BYTES, || place.clone())?;

    let translation = translation.map(|a| a.floats::<3>(asset)).transpose()?;
    let rotation = rotation.map(|a| a.floats::<4>(asset)).transpose()?;
    let scale = scale.map(|a| a.floats::<3>(asset)).transpose()?;
    (0..count)
        .map(|k| {
            let translation = translation.as_ref().map_or(DVec3::ZERO, |t| DVec3::from_array(t[k].map(f64::from)));
            let scale = scale.as_ref().map_or(DVec3::ONE, |s| DVec3::from_array(s[k].map(f64::from)));
            let rotation = rotation.as_ref().map_or(DQuat::IDENTITY, |r| DQuat::from_array(r[k].map(f64::from)));
            let length = rotation.length();
            if !(length > f64::MIN_POSITIVE && length.is_finite() && translation.is_finite() && scale.is_finite()) {
                return Err(invalid(&place, format_args!("instance {k} has no finite transform")));
            }
            Ok(DAffine3::from_scale_rotation_translation(scale, rotation.normalize(), translation))
        })
        .collect()
}
