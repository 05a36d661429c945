//! Skins and per-node morph weights, baked at rest into meshes of their own.
//!
//! A skinned vertex is where its joints put it, whatever the node's own transform (glTF 2.0 specification,
//! section 3.7.3.3). The scene keeps meshes in node space, so the bake divides the node's transform out.
use super::accessor::{Accessor, Component, Shape};
use super::error::{Fault, invalid, resolve};
use super::json;
use super::material::UvSource;
use super::nodes::{self, Forest};
use super::primitive::decode_mesh;
use super::validate::Asset;
use super::{SourceMesh, SourcePrimitive};
use glam::{DAffine3, DMat4, DVec3, Vec3};

/// Appends a baked mesh for every node that has a skin or its own morph weights, and points the node at it.
pub(super) fn bake_all(
    asset: &Asset,
    forest: &mut Forest,
    worlds: &[DAffine3],
    uvs: &[Option<UvSource>],
    meshes: &mut Vec<SourceMesh>,
    warnings: &mut Vec<String>,
) -> Result<(), Fault> {
    // Once for each mesh: many nodes may share one of many primitives.
    let has = |test: fn(&json::Primitive) -> bool| -> Vec<bool> {
        asset.json.meshes.iter().map(|mesh| mesh.primitives.iter().any(test)).collect()
    };
    let jointed = has(|primitive| primitive.attributes.contains_key("JOINTS_0"));
    let morphed = has(|primitive| !primitive.targets.is_empty());
    for (k, raw) in asset.json.nodes.iter().enumerate() {
        let Some(mesh) = forest.nodes[k].mesh else {
            continue;
        };
        let gltf_mesh = &asset.json.meshes[mesh as usize];
        let skin = raw.skin.filter(|_| jointed[mesh as usize]);
        let weights =
            raw.weights.as_deref().filter(|weights| morphed[mesh as usize] && Some(*weights) != gltf_mesh.weights.as_deref());
        if skin.is_none() && weights.is_none() {
            continue;
        }
        let place = nodes::place(asset.json, k);
        let mut repeated = Vec::new();
        let mut baked = decode_mesh(asset, uvs, mesh as usize, weights, &mut repeated)?;
        if let Some(skin) = skin {
            let node_from_world = worlds[k].inverse();
            if node_from_world.is_finite() {
                let skin = Skin::read(asset, skin.0, &node_from_world, worlds)?;
                for primitive in &mut baked.primitives {
                    skin.bake(asset, mesh, primitive)?;
                }
                warnings.push(format!("{place}: its skin is drawn at rest"));
            } else {
                warnings.push(format!("{place}: its transform has no inverse, its skin is ignored"));
            }
        }
        forest.nodes[k].mesh = Some(meshes.len() as u32);
        meshes.push(baked);
    }
    Ok(())
}

struct Skin {
    index: usize,
    /// `local_from_bind` of each joint: what it does to a vertex at full weight.
    joints: Vec<DAffine3>,
}

impl Skin {
    fn read(asset: &Asset, index: u64, node_from_world: &DAffine3, worlds: &[DAffine3]) -> Result<Skin, Fault> {
        let (index, raw) = resolve(&asset.json.skins, index, "skin", "node")?;
        let place = format!("skin {index}");
        let inverse_binds = match raw.inverse_bind_matrices {
            None => None,
            Some(accessor) => {
                let accessor = Accessor::resolve(asset, accessor.0, &place)?;
                if accessor.shape != Shape::Mat4 || accessor.component != Component::F32 || accessor.count < raw.joints.len() {
                    let reason = format!(
                        "inverseBindMatrices of {place} must be MAT4 of floats, one for each of {} joints",
                        raw.joints.len()
                    );
                    return Err(invalid(accessor.place(), reason));
                }
                Some(accessor.floats::<16>(asset)?)
            }
        };
        // Not only memory: nodes may share a skin, and each reads all of its joints.
        asset.budget.take(raw.joints.len(), size_of::<DAffine3>(), || place.clone())?;
        let mut joints = Vec::with_capacity(raw.joints.len());
        for (j, joint) in raw.joints.iter().enumerate() {
            let (node, _) = resolve(&asset.json.nodes, joint.0, "node", &place)?;
            let inverse_bind = inverse_binds
                .as_ref()
                .map_or(DAffine3::IDENTITY, |all| DAffine3::from_mat4(DMat4::from_cols_array(&all[j].map(f64::from))));
            let matrix = *node_from_world * worlds[node] * inverse_bind;
            if !matrix.is_finite() {
                return Err(invalid(place, format_args!("joint {j} has a matrix that is not finite")));
            }
            joints.push(matrix);
        }
        Ok(Skin { index, joints })
    }

    fn bake(&self, asset: &Asset, mesh: u32, primitive: &mut SourcePrimitive) -> Result<(), Fault> {
        let p = primitive.gltf_primitive as usize;
        let attributes = &asset.json.meshes[mesh as usize].primitives[p].attributes;
        let place = format!("mesh {mesh} primitive {p}");
        let count = primitive.positions.len();
        asset.budget.take(count, size_of::<DAffine3>() + size_of::<f64>(), || place.clone())?;
        let mut sums = vec![(DAffine3::ZERO, 0.0f64); count];
        for set in 0.. {
            let (Some(joints), Some(weights)) =
                (attributes.get(&format!("JOINTS_{set}")), attributes.get(&format!("WEIGHTS_{set}")))
            else {
                break;
            };
            let joints = Accessor::resolve(asset, joints.0, &place)?;
            let weights = Accessor::resolve(asset, weights.0, &place)?;
            let joints_typed = matches!(joints.component, Component::U8 | Component::U16) && !joints.normalized;
            let weights_typed = match weights.component {
                Component::F32 => true,
                Component::U8 | Component::U16 => weights.normalized,
                _ => false,
            };
            let shaped = joints.shape == Shape::Vec4 && weights.shape == Shape::Vec4;
            if !(shaped && joints_typed && weights_typed && joints.count == count && weights.count == count) {
                let reason = format!(
                    "JOINTS_{set} must be {count} VEC4 of U8 or U16, WEIGHTS_{set} {count} VEC4 of floats or normalized U8 or U16"
                );
                return Err(invalid(place, reason));
            }
            let (joints, weights) = (joints.integers::<4>(asset)?, weights.floats::<4>(asset)?);
            for (sum, (joints, weights)) in sums.iter_mut().zip(joints.into_iter().zip(weights)) {
                for (joint, weight) in joints.into_iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
                    let matrix = self.joints.get(joint as usize).ok_or_else(|| {
                        invalid(&place, format_args!("names joint {joint}, but skin {} has {}", self.index, self.joints.len()))
                    })?;
                    let weight = f64::from(weight);
                    sum.0.matrix3 += matrix.matrix3 * weight;
                    sum.0.translation += matrix.translation * weight;
                    sum.1 += weight;
                }
            }
        }
        self.apply(&sums, primitive, &place)
    }

    fn apply(&self, sums: &[(DAffine3, f64)], primitive: &mut SourcePrimitive, place: &str) -> Result<(), Fault> {
        for (at, (matrix, weight)) in sums.iter().enumerate() {
            if *weight == 0.0 {
                continue;
            }
            let position = DVec3::from(primitive.positions[at]);
            let moved = (matrix.transform_point3(position) / *weight).as_vec3();
            if !moved.is_finite() {
                return Err(invalid(place, format_args!("POSITION {at} is not finite once skinned")));
            }
            primitive.positions[at] = moved;
            if let Some(normals) = &mut primitive.normals {
                let turned = matrix.matrix3.inverse().transpose() * DVec3::from(normals[at]);
                let turned = turned.as_vec3().normalize_or_zero();
                normals[at] = if turned.is_finite() { turned } else { Vec3::ZERO };
            }
        }
        Ok(())
    }
}
