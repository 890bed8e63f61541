//! The PLY of the 3DGS authors (graphdeco-inria/gaussian-splatting, `scene/gaussian_model.py`, release of 2023): one row of
//! floats per Gaussian. x, y, z; unused normals; `f_dc_0..2`; `f_rest_*` with all coefficients of red first, then green, then
//! blue; `opacity` before the logistic function; `scale_0..2`, natural logarithms; `rot_0..3`, w, x, y, z. Exact.
//!
//! Features, which that format does not know, are further properties `feature_0..`. The colour that a scene was made to be drawn over is a
//! comment, `background R G B`, 0 to 1; other programs draw over what they like.

use super::ply_header::{Element, Header, Property};
use super::sieve::{Sieve, Splat};
use super::{Format, SplatFile, check};
use crate::SplatError;
use crate::error::off;
use qv_core::GaussianCloud;

/// What the comment with the background begins with.
const BACKGROUND: &str = "background ";

/// Where a row has what.
struct Layout<'a> {
    mean: [&'a Property; 3],
    log_scale: [&'a Property; 3],
    rotation: [&'a Property; 4],
    opacity: &'a Property,
    constant: [&'a Property; 3],
    /// Red, then green, then blue.
    rest: Vec<&'a Property>,
    /// Functions per colour in `rest`; more than are taken when the degree is 4.
    rest_count: usize,
    degree: u8,
    features: Vec<&'a Property>,
}

impl<'a> Layout<'a> {
    fn of(vertex: &'a Element) -> Result<Self, SplatError> {
        let one = |name: &str| vertex.property(name);
        let rest = numbered(vertex, "f_rest_")?;
        let degree = match rest.len() {
            0 => 0,
            9 => 1,
            24 => 2,
            45 | 72 => 3,
            found => {
                return Err(off("PLY element vertex, properties f_rest_*", "0, 9, 24, 45 or 72 of them", found));
            }
        };
        let features = numbered(vertex, "feature_")?;
        if features.len() > GaussianCloud::MAX_FEATURES {
            return Err(off("PLY element vertex, properties feature_*", "at most 16 of them", features.len()));
        }
        Ok(Self {
            mean: [one("x")?, one("y")?, one("z")?],
            constant: [one("f_dc_0")?, one("f_dc_1")?, one("f_dc_2")?],
            opacity: one("opacity")?,
            log_scale: [one("scale_0")?, one("scale_1")?, one("scale_2")?],
            rotation: [one("rot_0")?, one("rot_1")?, one("rot_2")?, one("rot_3")?],
            rest_count: rest.len() / 3,
            rest,
            degree,
            features,
        })
    }
}

/// Properties `prefix0`, `prefix1`, ... in the order of their numbers, which must have no gap.
fn numbered<'a>(vertex: &'a Element, prefix: &str) -> Result<Vec<&'a Property>, SplatError> {
    let count = vertex.properties.iter().filter(|property| property.name.starts_with(prefix)).count();
    (0..count).map(|number| vertex.property(&format!("{prefix}{number}"))).collect()
}

/// Reads a file. Properties that are not of the format are passed over; of harmonics of degree 4, degrees 0 to 3 are read.
///
/// # Errors
/// The header or its counts are off, or a property is missing.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    let header = Header::parse(bytes)?;
    let vertex = header.element("vertex")?;
    let layout = Layout::of(vertex)?;
    let functions = (layout.degree as usize + 1).pow(2);
    let mut sieve = Sieve::new(vertex.count, layout.degree, layout.features.len());
    let mut sh = vec![[0.0; 3]; functions];
    let mut features = vec![0.0; layout.features.len()];
    for row in vertex.rows(bytes) {
        sh[0] = layout.constant.map(|property| property.value(row));
        for k in 1..functions {
            sh[k] = std::array::from_fn(|c| layout.rest[c * layout.rest_count + k - 1].value(row));
        }
        for (feature, property) in features.iter_mut().zip(&layout.features) {
            *feature = property.value(row);
        }
        sieve.push(&Splat {
            mean: layout.mean.map(|property| property.value(row)),
            log_scale: layout.log_scale.map(|property| property.value(row)),
            rotation: layout.rotation.map(|property| property.value(row)),
            opacity_logit: layout.opacity.value(row),
            sh: &sh,
            features: &features,
        });
    }
    let lost = if layout.rest_count > 15 { vec!["spherical harmonics of degree 4".to_string()] } else { vec![] };
    Ok(SplatFile { background: background(&header), ..sieve.finish(Format::Ply, lost) })
}

/// The colour in the comments; none where there is none that means something.
fn background(header: &Header) -> Option<[f32; 3]> {
    let colour = header.comments.iter().find_map(|line| line.strip_prefix(BACKGROUND))?;
    let numbers: Vec<f32> = colour.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    let colour: [f32; 3] = numbers.try_into().ok()?;
    colour.iter().all(|c| (0.0..=1.0).contains(c)).then_some(colour)
}

/// A file of a cloud, exact. The normals that others expect are zeros.
///
/// # Errors
/// The cloud's arrays disagree, a number is not finite, or a quaternion is zero.
pub fn write(cloud: &GaussianCloud) -> Result<Vec<u8>, SplatError> {
    write_over(cloud, None)
}

/// The same of a scene that was made to be drawn over a colour, 0 to 1.
///
/// # Errors
/// As [`write()`].
pub fn write_over(cloud: &GaussianCloud, background: Option<[f32; 3]>) -> Result<Vec<u8>, SplatError> {
    check(cloud)?;
    let comment = background.map_or(String::new(), |[r, g, b]| format!("comment {BACKGROUND}{r} {g} {b}\n"));
    let rest = cloud.sh_count() - 1;
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    let mut some = |prefix: &str, count: usize| names.extend((0..count).map(|i| format!("{prefix}{i}")));
    some("f_dc_", 3);
    some("f_rest_", 3 * rest);
    names.push("opacity".into());
    let mut some = |prefix: &str, count: usize| names.extend((0..count).map(|i| format!("{prefix}{i}")));
    some("scale_", 3);
    some("rot_", 4);
    some("feature_", cloud.feature_count);
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\n{comment}element vertex {}\n{properties}end_header\n",
        cloud.len()
    );
    let mut out = header.into_bytes();
    out.reserve(4 * names.len() * cloud.len());
    for i in 0..cloud.len() {
        let mut put = |numbers: &[f32]| out.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        let sh = cloud.sh_of(i);
        put(&cloud.means[i]);
        put(&[0.0; 3]);
        put(&sh[0]);
        for c in 0..3 {
            sh[1..].iter().for_each(|colour| put(&[colour[c]]));
        }
        put(&[cloud.opacity_logits[i]]);
        put(&cloud.log_scales[i]);
        put(&cloud.rotations[i]);
        put(cloud.features_of(i));
    }
    Ok(out)
}
