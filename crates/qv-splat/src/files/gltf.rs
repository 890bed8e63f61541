//! glTF 2.0 with `KHR_gaussian_splatting` (KhronosGroup/glTF, release candidate of 2026), in a GLB or as JSON.
//!
//! Attributes of a primitive of points: `POSITION`; `KHR_gaussian_splatting:ROTATION`, x, y, z, w; `:SCALE`, standard
//! deviations; `:OPACITY`, 0 to 1; `:SH_DEGREE_l_COEF_n`, coefficients with Condon-Shortley phase as in a cloud. Written as
//! floats; read as floats or as the integers that the extension allows. Features, which it does not know, are attributes
//! `_FEATURE_n` of our own.

use super::accessor::{Accessor, TYPES, entry, number};
use super::format::{Beside, Format, SplatFile};
use super::glb;
use super::quantised::{logit, opacity};
use super::sieve::{Sieve, Splat, check};
use crate::SplatError;
use crate::error::off;
use crate::harmonics::{FUNCTIONS, mixed, rotation};
use glam::{DMat3, DMat4, DQuat, DVec3};
use qv_core::GaussianCloud;
use serde_json::{Value, json};
use std::borrow::Cow;

const EXTENSION: &str = "KHR_gaussian_splatting";
/// A file has at least this many bytes per Gaussian; one with fewer places the same data again and again.
const LEAST_BYTES: usize = 16;
/// Most nodes and primitives that are visited, and how deep.
const MOST_NODES: usize = 10_000;
const DEEPEST: usize = 64;
/// Relative difference of the axes' lengths up to which a transform counts as uniform.
const UNIFORM: f64 = 1e-4;

/// A primitive and where it is placed.
struct PlacedPrimitive<'a> {
    accessors: Vec<Accessor<'a>>,
    features: Vec<Accessor<'a>>,
    world_from_node: DMat4,
    /// Degree of its harmonics.
    degree: u8,
}

/// Reads all Gaussians of the default scene, with the transforms of their nodes, which must be rotation, translation and
/// uniform scale. When primitives differ in the degree of their harmonics or in their features, the larger counts, and what a
/// primitive lacks is zero.
///
/// # Errors
/// The container or the document is off, an attribute is missing or beyond the data, a kernel is none that is known, a
/// transform shears or mirrors, or the same data is placed so often that the file would blow up.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    read_with(bytes, &mut |_| Err("not looked for".into()))
}

/// The same of a file whose buffers may be files beside it.
///
/// # Errors
/// As [`read`], or a buffer is missing.
pub fn read_with(bytes: &[u8], beside: Beside) -> Result<SplatFile, SplatError> {
    let (document, binary) = glb::open(bytes)?;
    let buffers = glb::buffers(&document, binary, beside)?;
    let mut placed = Vec::new();
    let mut walk = Walk { document: &document, buffers: &buffers, visited: 0, placed: &mut placed, other: 0 };
    let scene = number(&document, "scene", "glTF")?.unwrap_or(0);
    walk.children(entry(&document, "scenes", scene)?, "nodes", DMat4::IDENTITY, 0)?;
    let other = walk.other;
    if placed.is_empty() {
        return Err(off("glTF", format!("a primitive with {EXTENSION} in the scene"), "none"));
    }
    let count: usize = placed.iter().map(|one| one.accessors[0].count).fold(0, usize::saturating_add);
    let there = buffers.iter().map(|buffer| buffer.len()).sum::<usize>().max(bytes.len());
    if count > there / LEAST_BYTES {
        let (limit, found) = ((there / LEAST_BYTES) as u64, count as u64);
        return Err(SplatError::TooLarge { place: "glTF, Gaussians in a file of its size".into(), limit, found });
    }
    let degree = placed.iter().map(|one| one.degree).max().unwrap_or(0);
    let features = placed.iter().map(|one| one.features.len()).max().unwrap_or(0);
    let mut sieve = Sieve::new(count, degree, features);
    for one in &placed {
        add(one, degree, features, &mut sieve)?;
    }
    let lost = if other > 0 { vec![format!("{other} primitives that are no Gaussians")] } else { vec![] };
    Ok(sieve.finish(Format::Gltf, lost))
}

/// A walk through the nodes of a scene.
struct Walk<'v, 'a> {
    document: &'v Value,
    buffers: &'a [Cow<'a, [u8]>],
    visited: usize,
    placed: &'v mut Vec<PlacedPrimitive<'a>>,
    /// Primitives without the extension.
    other: usize,
}

impl<'a> Walk<'_, 'a> {
    fn children(&mut self, parent: &Value, list: &str, from: DMat4, depth: usize) -> Result<(), SplatError> {
        if depth > DEEPEST {
            return Err(off("glTF nodes", format!("at most {DEEPEST} inside each other"), "more"));
        }
        for child in parent.get(list).and_then(Value::as_array).into_iter().flatten() {
            let index = child.as_u64().ok_or_else(|| off(format!("glTF {list}"), "indices", child))?;
            self.count()?;
            let node = entry(self.document, "nodes", index)?;
            let world_from_node = from * transform(node, index)?;
            if let Some(mesh) = number(node, "mesh", "glTF node")? {
                self.mesh(mesh, world_from_node)?;
            }
            self.children(node, "children", world_from_node, depth + 1)?;
        }
        Ok(())
    }

    /// Counts a node or primitive: a small file can name the same ones again and again.
    fn count(&mut self) -> Result<(), SplatError> {
        self.visited += 1;
        if self.visited > MOST_NODES {
            let place = "glTF, nodes and primitives that a scene shows".into();
            return Err(SplatError::TooLarge { place, limit: MOST_NODES as u64, found: self.visited as u64 });
        }
        Ok(())
    }

    fn mesh(&mut self, index: u64, world_from_node: DMat4) -> Result<(), SplatError> {
        let mesh = entry(self.document, "meshes", index)?;
        for primitive in mesh.get("primitives").and_then(Value::as_array).into_iter().flatten() {
            self.count()?;
            match primitive.get("extensions").and_then(|extensions| extensions.get(EXTENSION)) {
                Some(extension) => {
                    let one = self.primitive(primitive, extension, world_from_node)?;
                    self.placed.push(one);
                }
                None => self.other += 1,
            }
        }
        Ok(())
    }

    fn primitive(&self, primitive: &Value, extension: &Value, place: DMat4) -> Result<PlacedPrimitive<'a>, SplatError> {
        for (key, known) in [
            ("kernel", "ellipse"),
            ("colorSpace", "srgb_rec709_display"),
            ("projection", "perspective"),
            ("sortingMethod", "cameraDistance"),
        ] {
            // What is drawn otherwise would look otherwise.
            if let Some(found) = extension.get(key).filter(|found| found.as_str() != Some(known)) {
                let found = found.as_str().map_or_else(|| found.to_string(), String::from);
                return Err(off(format!("glTF {EXTENSION}, {key}"), known, found));
            }
        }
        if let Some(more) = extension.get("extensions").and_then(Value::as_object).and_then(|more| more.keys().next()) {
            return Err(off(format!("glTF {EXTENSION}"), "no compression", more));
        }
        let attribute = |name: &str| primitive.get("attributes").and_then(|attributes| attributes.get(name));
        let optional = |name: &str, width: usize| match attribute(name).map(|index| (index, index.as_u64())) {
            None => Ok(None),
            Some((_, Some(index))) => Accessor::new(self.document, self.buffers, index, width).map(Some),
            Some((found, None)) => Err(off(format!("glTF attribute {name}"), "an index", found)),
        };
        let needed = |name: &str, width: usize| {
            optional(name, width)?.ok_or_else(|| off("glTF attributes", name, "no such attribute"))
        };
        let own = |name: &str| format!("{EXTENSION}:{name}");
        let mut accessors = vec![
            needed("POSITION", 3)?,
            needed(&own("ROTATION"), 4)?,
            needed(&own("SCALE"), 3)?,
            needed(&own("OPACITY"), 1)?,
            needed(&own("SH_DEGREE_0_COEF_0"), 3)?,
        ];
        let mut degree = 0;
        while degree < GaussianCloud::MAX_SH_DEGREE
            && attribute(&own(&format!("SH_DEGREE_{}_COEF_0", degree + 1))).is_some()
        {
            degree += 1;
            for n in 0..=2 * degree {
                accessors.push(needed(&own(&format!("SH_DEGREE_{degree}_COEF_{n}")), 3)?);
            }
        }
        let mut features = Vec::new();
        while let Some(feature) = optional(&format!("_FEATURE_{}", features.len()), 1)? {
            if features.len() == GaussianCloud::MAX_FEATURES {
                let (place, limit) = ("glTF, attributes _FEATURE_n".into(), GaussianCloud::MAX_FEATURES as u64);
                return Err(SplatError::TooLarge { place, limit, found: limit + 1 });
            }
            features.push(feature);
        }
        let count = accessors[0].count;
        if let Some(other) = accessors.iter().chain(&features).find(|accessor| accessor.count != count) {
            return Err(off("glTF attributes", format!("{count} items in each"), other.count));
        }
        Ok(PlacedPrimitive { accessors, features, world_from_node: place, degree })
    }
}

/// `parent_from_node`.
fn transform(node: &Value, index: u64) -> Result<DMat4, SplatError> {
    let numbers = |key: &str, standard: &[f64]| -> Result<Vec<f64>, SplatError> {
        let Some(found) = node.get(key) else { return Ok(standard.to_vec()) };
        let list: Option<Vec<f64>> = found.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
        let expected = || format!("{} numbers", standard.len());
        list.filter(|list| list.len() == standard.len())
            .ok_or_else(|| off(format!("glTF node {index}, {key}"), expected(), found))
    };
    if node.get("matrix").is_some() {
        let matrix = numbers("matrix", &[0.0; 16])?;
        return Ok(DMat4::from_cols_array(&std::array::from_fn(|i| matrix[i])));
    }
    let (t, r) = (numbers("translation", &[0.0; 3])?, numbers("rotation", &[0.0, 0.0, 0.0, 1.0])?);
    let s = numbers("scale", &[1.0; 3])?;
    let turn = DQuat::from_xyzw(r[0], r[1], r[2], r[3]).normalize();
    let (scale, translation) = (DVec3::new(s[0], s[1], s[2]), DVec3::new(t[0], t[1], t[2]));
    Ok(DMat4::from_scale_rotation_translation(scale, turn, translation))
}

/// Rotation and scale of a transform.
fn decomposed(matrix: DMat4) -> Result<(DMat3, f64), SplatError> {
    let linear = DMat3::from_mat4(matrix);
    let scale = linear.determinant().cbrt();
    let turn = linear * (1.0 / scale);
    let off_by = (turn * turn.transpose() - DMat3::IDENTITY).to_cols_array().iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let good = scale > 0.0 && off_by <= UNIFORM && matrix.is_finite();
    if good {
        return Ok((turn, scale));
    }
    let lengths = [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis.length());
    let expected = "rotation, translation and uniform positive scale";
    Err(off("glTF, transform of a node", expected, format!("axes of lengths {lengths:?}, scale {scale}")))
}

fn add(one: &PlacedPrimitive, degree: u8, feature_count: usize, sieve: &mut Sieve) -> Result<(), SplatError> {
    let (turn, scale) = decomposed(one.world_from_node)?;
    let straight = turn.abs_diff_eq(DMat3::IDENTITY, 1e-9);
    let harmonics = (!straight).then(|| rotation(turn));
    let quaternion = DQuat::from_mat3(&turn).as_quat();
    let functions = (degree as usize + 1).pow(2);
    let mut features = vec![0.0; feature_count];
    for i in 0..one.accessors[0].count {
        let [position, rotation, scales, opacities] = [0, 1, 2, 3].map(|k| one.accessors[k].get::<4>(i));
        if scales.iter().any(|length| *length < 0.0) {
            let expected = "standard deviations, which are not negative (drafts of the extension had logarithms)";
            return Err(off(format!("glTF {EXTENSION}:SCALE, item {i}"), expected, format!("{:?}", &scales[..3])));
        }
        if !(-1e-6..=1.0 + 1e-6).contains(&opacities[0]) && !opacities[0].is_nan() {
            return Err(off(format!("glTF {EXTENSION}:OPACITY, item {i}"), "0 to 1", opacities[0]));
        }
        let mut sh = [[0.0; 3]; FUNCTIONS];
        for (k, accessor) in one.accessors[4..].iter().enumerate() {
            sh[k] = accessor.get(i);
        }
        if let Some(matrix) = &harmonics {
            sh = mixed(matrix, &sh);
        }
        for (feature, accessor) in features.iter_mut().zip(&one.features) {
            *feature = accessor.get::<1>(i)[0];
        }
        let [x, y, z, w] = rotation;
        let (mean, axes) = if one.world_from_node == DMat4::IDENTITY {
            ([position[0], position[1], position[2]], [w, x, y, z])
        } else {
            let mean = one.world_from_node.transform_point3(DVec3::new(
                f64::from(position[0]),
                f64::from(position[1]),
                f64::from(position[2]),
            ));
            let axes = quaternion * glam::Quat::from_xyzw(x, y, z, w);
            (mean.as_vec3().to_array(), [axes.w, axes.x, axes.y, axes.z])
        };
        sieve.push(&Splat {
            mean,
            log_scale: std::array::from_fn(|k| (f64::from(scales[k]) * scale).ln() as f32),
            rotation: axes,
            opacity_logit: logit(opacities[0]),
            sh: &sh[..functions],
            features: &features,
        });
    }
    Ok(())
}

/// A GLB of a cloud, all numbers floats, in a node without a transform. Positions, harmonics and features are exact.
///
/// # Errors
/// The cloud's arrays disagree, a number is not finite, a quaternion is zero, a log scale's exponential is not finite, or the
/// file would be larger than 4 GiB.
pub fn write(cloud: &GaussianCloud) -> Result<Vec<u8>, SplatError> {
    check(cloud)?;
    let mut file = GltfWriter::default();
    let of = |name: &str| format!("{EXTENSION}:{name}");
    file.add("POSITION".into(), cloud.means.as_flattened().to_vec(), 3);
    let low = |k: usize| cloud.means.iter().fold(f32::INFINITY, |least, mean| least.min(mean[k]));
    let high = |k: usize| cloud.means.iter().fold(f32::NEG_INFINITY, |most, mean| most.max(mean[k]));
    if !cloud.is_empty() {
        file.accessors[0]["min"] = json!([low(0), low(1), low(2)]);
        file.accessors[0]["max"] = json!([high(0), high(1), high(2)]);
    }
    let unit = |q: &[f32; 4]| {
        let length = q.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        [q[1], q[2], q[3], q[0]].map(|x| (f64::from(x) / length) as f32)
    };
    file.add(of("ROTATION"), cloud.rotations.iter().flat_map(unit).collect(), 4);
    let scales: Vec<f32> = cloud.log_scales.iter().flatten().map(|log| f64::from(*log).exp() as f32).collect();
    if let Some(index) = scales.iter().position(|scale| !scale.is_finite()) {
        let expected = "an exponential within single precision";
        return Err(off(format!("glTF, log scale of Gaussian {}", index / 3), expected, scales[index]));
    }
    file.add(of("SCALE"), scales, 3);
    file.add(of("OPACITY"), cloud.opacity_logits.iter().map(|logit| opacity(*logit)).collect(), 1);
    let mut k = 0;
    for degree in 0..=cloud.sh_degree {
        for n in 0..=2 * degree {
            let coefficients = (0..cloud.len()).flat_map(|i| cloud.sh_of(i)[k]).collect();
            file.add(of(&format!("SH_DEGREE_{degree}_COEF_{n}")), coefficients, 3);
            k += 1;
        }
    }
    for n in 0..cloud.feature_count {
        file.add(format!("_FEATURE_{n}"), (0..cloud.len()).map(|i| cloud.features_of(i)[n]).collect(), 1);
    }
    file.close()
}

/// A file as it grows.
#[derive(Default)]
struct GltfWriter {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    attributes: serde_json::Map<String, Value>,
}

impl GltfWriter {
    fn add(&mut self, name: String, numbers: Vec<f32>, width: usize) {
        let (start, length) = (self.binary.len(), 4 * numbers.len());
        self.binary.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        self.attributes.insert(name, self.accessors.len().into());
        let (view, count) = (self.views.len(), numbers.len() / width);
        let kind = TYPES[width - 1];
        self.accessors.push(json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind}));
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": length, "target": 34962}));
    }

    fn close(self) -> Result<Vec<u8>, SplatError> {
        let extension = json!({EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}});
        let document = json!({
            "asset": {"version": "2.0", "generator": "qv-splat"}, "extensionsUsed": [EXTENSION],
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"mode": 0, "attributes": self.attributes, "extensions": extension}]}],
            "buffers": [{"byteLength": self.binary.len()}], "bufferViews": self.views, "accessors": self.accessors,
        });
        glb::close(&document, self.binary)
    }
}
