//! Meshes: attributes decoded, every triangle topology made a triangle list, morph targets at rest.
use super::accessor::{Accessor, Component, Shape};
use super::error::{Fault, invalid, resolve};
use super::json;
use super::material::UvSource;
use super::validate::Asset;
use super::{SourceMesh, SourcePrimitive};
use bytemuck::allocation::cast_vec;
use glam::{Vec2, Vec3};

const MODE_POINTS: u64 = 0;
const MODE_LINE_STRIP: u64 = 3;
const MODE_TRIANGLES: u64 = 4;
const MODE_TRIANGLE_STRIP: u64 = 5;
const MODE_TRIANGLE_FAN: u64 = 6;

/// Decodes mesh `m` with its morph targets weighted by `weights`, or by the mesh's own.
pub(super) fn decode_mesh(
    asset: &Asset,
    uvs: &[Option<UvSource>],
    m: usize,
    weights: Option<&[f64]>,
    warnings: &mut Vec<String>,
) -> Result<SourceMesh, Fault> {
    let raw = &asset.json.meshes[m];
    let weights = weights.or(raw.weights.as_deref()).unwrap_or(&[]);
    let mut primitives = Vec::with_capacity(raw.primitives.len());
    for (p, primitive) in raw.primitives.iter().enumerate() {
        let job = Job { asset, raw: primitive, weights, place: format!("mesh {m} primitive {p}") };
        primitives.extend(job.decode(p, uvs, warnings)?);
    }
    if raw.primitives.iter().any(|primitive| !primitive.targets.is_empty()) {
        warnings.push(format!("mesh {m}: morph targets are drawn at rest"));
    }
    Ok(SourceMesh { name: raw.name.clone(), gltf_mesh: m as u32, primitives })
}

struct Job<'j> {
    asset: &'j Asset<'j>,
    raw: &'j json::Primitive,
    weights: &'j [f64],
    place: String,
}

impl Job<'_> {
    fn decode(&self, p: usize, uvs: &[Option<UvSource>], warnings: &mut Vec<String>) -> Result<Option<SourcePrimitive>, Fault> {
        // A mesh is decoded again for each node that bakes it.
        self.asset.budget.take(1, size_of::<SourcePrimitive>(), || self.place.clone())?;
        let mode = self.raw.mode.map_or(MODE_TRIANGLES, |mode| mode.0);
        if mode > MODE_TRIANGLE_FAN {
            return Err(invalid(&self.place, format_args!("mode {mode}, allowed are 0 to 6")));
        }
        let material = match self.raw.material {
            Some(material) => Some(resolve(&self.asset.json.materials, material.0, "material", &self.place)?.0),
            None => None,
        };
        if (MODE_POINTS..=MODE_LINE_STRIP).contains(&mode) {
            warnings.push(format!("{}: points and lines are skipped", self.place));
            return Ok(None);
        }
        let Some(accessor) = self.attribute("POSITION")? else {
            warnings.push(format!("{}: has no POSITION and is skipped", self.place));
            return Ok(None);
        };
        let mut positions = self.positions(accessor)?;
        let mut normals = self.normals(positions.len(), warnings)?;
        self.morph(&mut positions, normals.as_mut())?;
        if let Some(at) = positions.iter().position(|position| !position.is_finite()) {
            return Err(invalid(&self.place, format_args!("POSITION {at} is {}, not finite", positions[at])));
        }
        let uv_source = material.and_then(|material| uvs.get(material)).and_then(Option::as_ref);
        let uvs = match uv_source {
            Some(source) => self.uvs(source, positions.len(), warnings)?,
            None => None,
        };
        let colors = self.colors(positions.len())?;
        let indices = self.indices(mode, positions.len(), warnings)?;
        Ok(Some(SourcePrimitive {
            gltf_primitive: p as u32,
            positions,
            normals,
            uvs,
            colors,
            indices,
            material: material.map(|material| material as u32),
        }))
    }

    fn attribute(&self, name: &str) -> Result<Option<Accessor<'_>>, Fault> {
        let index = self.raw.attributes.get(name);
        index.map(|index| Accessor::resolve(self.asset, index.0, format_args!("{} {name}", self.place))).transpose()
    }

    fn refuse(&self, accessor: &Accessor, name: &str, needs: &str) -> Fault {
        let normalized = if accessor.normalized { " normalized" } else { "" };
        let found = format!("{:?} of{normalized} {:?}", accessor.shape, accessor.component);
        invalid(accessor.place(), format_args!("{name} of {} is {found}, needs {needs}", self.place))
    }

    fn same_count(&self, accessor: &Accessor, name: &str, count: usize) -> Result<(), Fault> {
        if accessor.count != count {
            let reason = format!("{name} has {} elements, POSITION has {count}", accessor.count);
            return Err(invalid(&self.place, reason));
        }
        Ok(())
    }

    fn positions(&self, accessor: Accessor) -> Result<Vec<Vec3>, Fault> {
        if accessor.shape != Shape::Vec3 {
            return Err(self.refuse(&accessor, "POSITION", "VEC3"));
        }
        match accessor.component {
            Component::F32 => {}
            Component::U32 => {
                return Err(self.refuse(&accessor, "POSITION", "floats, or 8 or 16 bit integers"));
            }
            _ if !self.asset.quantized => {
                return Err(self.refuse(&accessor, "POSITION", "floats, or the extension KHR_mesh_quantization"));
            }
            _ => {}
        }
        accessor.floats::<3>(self.asset).map(cast_vec)
    }

    fn normals(&self, count: usize, warnings: &mut Vec<String>) -> Result<Option<Vec<Vec3>>, Fault> {
        let Some(accessor) = self.attribute("NORMAL")? else {
            return Ok(None);
        };
        let typed = match accessor.component {
            Component::F32 => true,
            Component::I8 | Component::I16 => self.asset.quantized && accessor.normalized,
            _ => false,
        };
        if accessor.shape != Shape::Vec3 || !typed {
            return Err(self.refuse(&accessor, "NORMAL", "VEC3 of floats, or normalized I8 or I16 with KHR_mesh_quantization"));
        }
        self.same_count(&accessor, "NORMAL", count)?;
        let mut normals: Vec<Vec3> = cast_vec(accessor.floats::<3>(self.asset)?);
        let mut replaced = 0;
        for normal in normals.iter_mut().filter(|normal| !normal.is_finite()) {
            *normal = Vec3::ZERO;
            replaced += 1;
        }
        if replaced > 0 {
            warnings.push(format!("{}: {replaced} normals that are not finite become zero", self.place));
        }
        Ok(Some(normals))
    }

    /// Adds the weighted morph targets: glTF 2.0 specification, section 3.7.2.2.
    fn morph(&self, positions: &mut [Vec3], mut normals: Option<&mut Vec<Vec3>>) -> Result<(), Fault> {
        let targets = &self.raw.targets;
        if !self.weights.is_empty() && !targets.is_empty() && self.weights.len() != targets.len() {
            let reason = format!("{} morph targets, but {} weights", targets.len(), self.weights.len());
            return Err(invalid(&self.place, reason));
        }
        for (t, (target, &weight)) in targets.iter().zip(self.weights).enumerate() {
            if weight == 0.0 {
                continue;
            }
            let add = |name: &str, onto: &mut [Vec3]| -> Result<(), Fault> {
                let Some(index) = target.get(name) else {
                    return Ok(());
                };
                let name = format!("target {t} {name}");
                let accessor = Accessor::resolve(self.asset, index.0, format_args!("{} {name}", self.place))?;
                let integers = matches!(accessor.component, Component::I8 | Component::I16) && self.asset.quantized;
                if accessor.shape != Shape::Vec3 || !(accessor.component == Component::F32 || integers) {
                    return Err(self.refuse(&accessor, &name, "VEC3 of floats, or I8 or I16 with KHR_mesh_quantization"));
                }
                self.same_count(&accessor, &name, onto.len())?;
                for (value, delta) in onto.iter_mut().zip(accessor.floats::<3>(self.asset)?) {
                    *value += weight as f32 * Vec3::from_array(delta);
                }
                Ok(())
            };
            add("POSITION", positions)?;
            if let Some(normals) = normals.as_mut() {
                add("NORMAL", normals)?;
            }
        }
        Ok(())
    }

    fn uvs(&self, source: &UvSource, count: usize, warnings: &mut Vec<String>) -> Result<Option<Vec<Vec2>>, Fault> {
        let name = format!("TEXCOORD_{}", source.set);
        let Some(accessor) = self.attribute(&name)? else {
            return Ok(None);
        };
        let typed = match accessor.component {
            Component::F32 => true,
            Component::U8 | Component::U16 => accessor.normalized || self.asset.quantized,
            Component::I8 | Component::I16 => self.asset.quantized,
            Component::U32 => false,
        };
        if accessor.shape != Shape::Vec2 || !typed {
            return Err(self.refuse(&accessor, &name, "VEC2 of floats or normalized U8 or U16, or KHR_mesh_quantization"));
        }
        self.same_count(&accessor, &name, count)?;
        let mut uvs: Vec<Vec2> = cast_vec(accessor.floats::<2>(self.asset)?);
        if let Some(transform) = source.transform {
            uvs.iter_mut().for_each(|uv| *uv = transform.transform_point2(*uv));
        }
        let mut replaced = 0;
        for uv in uvs.iter_mut().filter(|uv| !uv.is_finite()) {
            *uv = Vec2::ZERO;
            replaced += 1;
        }
        if replaced > 0 {
            warnings.push(format!("{}: {replaced} {name} that are not finite become zero", self.place));
        }
        Ok(Some(uvs))
    }

    /// Integers count as normalized whether or not the file says so: nothing else has a meaning for a colour.
    fn colors(&self, count: usize) -> Result<Option<Vec<[u8; 4]>>, Fault> {
        let Some(mut accessor) = self.attribute("COLOR_0")? else {
            return Ok(None);
        };
        if !matches!(accessor.component, Component::F32 | Component::U8 | Component::U16)
            || !matches!(accessor.shape, Shape::Vec3 | Shape::Vec4)
        {
            return Err(self.refuse(&accessor, "COLOR_0", "VEC3 or VEC4 of floats or normalized U8 or U16"));
        }
        self.same_count(&accessor, "COLOR_0", count)?;
        accessor.normalized = accessor.component != Component::F32;
        // `as` saturates and takes NaN to 0.
        let unorm8 = |value: f32| (value * 255.0).round() as u8;
        Ok(Some(if accessor.shape == Shape::Vec3 {
            let colors = accessor.floats::<3>(self.asset)?;
            colors.into_iter().map(|[r, g, b]| [unorm8(r), unorm8(g), unorm8(b), 255]).collect()
        } else {
            accessor.floats::<4>(self.asset)?.into_iter().map(|color| color.map(unorm8)).collect()
        }))
    }

    fn indices(&self, mode: u64, vertices: usize, warnings: &mut Vec<String>) -> Result<Vec<u32>, Fault> {
        let corners = match self.raw.indices {
            None => None,
            Some(index) => {
                let accessor = Accessor::resolve(self.asset, index.0, format_args!("{} indices", self.place))?;
                let typed = matches!(accessor.component, Component::U8 | Component::U16 | Component::U32);
                if accessor.shape != Shape::Scalar || accessor.normalized || !typed {
                    return Err(self.refuse(&accessor, "indices", "SCALAR of unsigned integers"));
                }
                let corners: Vec<u32> = cast_vec(accessor.integers::<1>(self.asset)?);
                // A fold without early exit vectorises; the search runs only to name the culprit.
                let largest = corners.iter().copied().fold(0, u32::max);
                if largest as usize >= vertices {
                    let at = corners.iter().position(|c| *c as usize >= vertices).unwrap_or(0);
                    let reason = format!("index {at} of {} is {}, but there are {vertices} vertices", self.place, corners[at]);
                    return Err(invalid(accessor.place(), reason));
                }
                Some(corners)
            }
        };
        let count = corners.as_ref().map_or(vertices, Vec::len);
        if mode == MODE_TRIANGLES {
            if !count.is_multiple_of(3) {
                warnings.push(format!("{}: {count} corners are no whole number of triangles", self.place));
            }
            let whole = count - count % 3;
            return match corners {
                Some(mut corners) => {
                    corners.truncate(whole);
                    Ok(corners)
                }
                None => {
                    self.asset.budget.take(whole, 4, || self.place.clone())?;
                    Ok((0..whole as u32).collect())
                }
            };
        }
        let triangles = count.saturating_sub(2);
        self.asset.budget.take(triangles, 12, || self.place.clone())?;
        let corner = |k: usize| corners.as_ref().map_or(k as u32, |corners| corners[k]);
        // Corner order by the glTF 2.0 specification, section 3.7.2.1.
        let list = (0..triangles).flat_map(|k| {
            if mode == MODE_TRIANGLE_STRIP {
                [corner(k), corner(k + 1 + k % 2), corner(k + 2 - k % 2)]
            } else {
                [corner(k + 1), corner(k + 2), corner(0)]
            }
        });
        Ok(list.collect())
    }
}
