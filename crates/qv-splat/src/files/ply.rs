//! The PLY of the 3DGS authors (graphdeco-inria/gaussian-splatting, `scene/gaussian_model.py`, release of 2023): one row of
//! floats per Gaussian. x, y, z; unused normals; `f_dc_0..2`; `f_rest_*` with all coefficients of red first, then green, then
//! blue; `opacity` before the logistic function; `scale_0..2`, natural logarithms; `rot_0..3`, w, x, y, z. Exact.
//!
//! Features, which that format does not know, are further properties `feature_0..`. The colour that a scene was made to be drawn over is a
//! comment, `background R G B`, 0 to 1; other programs draw over what they like. A property `filter_3D` is Mip-Splatting's: such a scene is to be
//! drawn with anti-aliasing.

use super::format::{Format, SplatFile};
use super::ply_header::{Element, Header, Property, head_of, is_blank};
use super::quantised::{logit, opacity};
use super::sieve::{Sieve, Splat, check};
use crate::SplatError;
use crate::error::off;
use qv_core::GaussianCloud;
use std::io::{self, Read};

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
    /// Deviation of Mip-Splatting's filter.
    filter: Option<&'a Property>,
}

/// Bytes of rows that are read at a time.
const BLOCK: usize = 1 << 20;

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
            filter: vertex.properties.iter().find(|property| property.name.eq_ignore_ascii_case("filter_3D")),
        })
    }
}

/// Properties `prefix0`, `prefix1`, ... in the order of their numbers, which must have no gap.
fn numbered<'a>(vertex: &'a Element, prefix: &str) -> Result<Vec<&'a Property>, SplatError> {
    let count = vertex.properties.iter().filter(|property| property.name.starts_with(prefix)).count();
    (0..count).map(|number| vertex.property(&format!("{prefix}{number}"))).collect()
}

/// Reads a file. Properties that are not of the format are passed over; of harmonics of degree 4, degrees 0 to 3 are read. The filter of
/// Mip-Splatting, `filter_3D`, is applied.
///
/// # Errors
/// The header or its counts are off, or a property is missing.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    read_stream(&mut &bytes[..], bytes.len() as u64)
}

/// Reads a file of `length` bytes from a stream, of which no more than a mebibyte, or a row, is held beside the cloud.
///
/// # Errors
/// As [`read`]; or the stream cannot be read.
pub fn read_stream(source: &mut dyn Read, length: u64) -> Result<SplatFile, SplatError> {
    let unread = |error: io::Error| off("PLY file", format!("{length} bytes that can be read"), error);
    let head = head_of(source)?;
    let header = Header::parse_head(&head, length)?;
    let vertex = header.element("vertex")?;
    let layout = Layout::of(vertex)?;
    let mut source = (&head[header.body..]).chain(source);
    let before = (vertex.start - header.body) as u64;
    io::copy(&mut source.by_ref().take(before), &mut io::sink()).map_err(unread)?;
    let mut sieve = Sieve::new(vertex.count, layout.degree, layout.features.len());
    let mut rows = Rows::of(&layout);
    let at_once = (BLOCK / vertex.stride).clamp(1, vertex.count.max(1));
    let mut block = vec![0; at_once * vertex.stride];
    let mut left = vertex.count;
    while left > 0 {
        let count = left.min(at_once);
        let block = &mut block[..count * vertex.stride];
        source.read_exact(block).map_err(unread)?;
        block.chunks_exact(vertex.stride).for_each(|row| rows.push(&layout, row, &mut sieve));
        left -= count;
    }
    let mut blank = true;
    loop {
        match source.read(&mut block).map_err(unread)? {
            0 => break,
            count => blank &= is_blank(&block[..count]),
        }
    }
    let mut remarks = header.remarks(blank);
    if layout.rest_count > 15 {
        remarks.lost.push("spherical harmonics of degree 4".to_string());
    }
    if layout.filter.is_some() {
        remarks.remarks.push("filter_3D of Mip-Splatting is applied to scales and opacities".to_string());
    }
    let file = sieve.finish(Format::Ply, remarks.lost);
    remarks.remarks.extend(linear(&file.cloud));
    Ok(SplatFile {
        background: background(&header),
        antialias: layout.filter.is_some(),
        remarks: remarks.remarks,
        ..file
    })
}

/// Gaussians that show a convention.
const ENOUGH: usize = 20;

/// Values that are hardly logarithms and logits: scales none of which is below a metre, opacities all from 0 to 1.
fn linear(cloud: &GaussianCloud) -> Vec<String> {
    let mut remarks = Vec::new();
    let (scales, opacities) = (&cloud.log_scales, &cloud.opacity_logits);
    if scales.len() < ENOUGH {
        return remarks;
    }
    if scales.iter().all(|s| s.iter().all(|x| *x > 0.0)) {
        remarks.push("all scales are above 0: they may be metres where natural logarithms belong".to_string());
    }
    let first = opacities.first().copied().unwrap_or_default();
    if opacities.iter().all(|x| (0.0..=1.0).contains(x)) && opacities.iter().any(|x| *x != first) {
        remarks.push("all opacities are from 0 to 1: they may be opacities where logits belong".to_string());
    }
    remarks
}

/// What rows are unpacked into.
struct Rows {
    sh: Vec<[f32; 3]>,
    features: Vec<f32>,
}

impl Rows {
    fn of(layout: &Layout) -> Self {
        let functions = (layout.degree as usize + 1).pow(2);
        Self { sh: vec![[0.0; 3]; functions], features: vec![0.0; layout.features.len()] }
    }

    fn push(&mut self, layout: &Layout, row: &[u8], sieve: &mut Sieve) {
        self.sh[0] = layout.constant.map(|property| property.value(row));
        for k in 1..self.sh.len() {
            self.sh[k] = std::array::from_fn(|c| layout.rest[c * layout.rest_count + k - 1].value(row));
        }
        for (feature, property) in self.features.iter_mut().zip(&layout.features) {
            *feature = property.value(row);
        }
        let mut splat = Splat {
            mean: layout.mean.map(|property| property.value(row)),
            log_scale: layout.log_scale.map(|property| property.value(row)),
            rotation: layout.rotation.map(|property| property.value(row)),
            opacity_logit: layout.opacity.value(row),
            sh: &self.sh,
            features: &self.features,
        };
        if let Some(filter) = layout.filter {
            smooth(&mut splat, f64::from(filter.value(row)));
        }
        sieve.push(&splat);
    }
}

/// Mip-Splatting's filter (Yu et al., 2024, equation 9): the Gaussian is convolved with one of deviation `filter`, and its opacity shrinks as
/// its volume grows, so that s becomes sqrt(s² + f²) and the opacity is multiplied by the product of s / sqrt(s² + f²) over the axes.
fn smooth(splat: &mut Splat, filter: f64) {
    let mut share = 1.0;
    for log in &mut splat.log_scale {
        let scale = f64::from(*log).exp();
        let wide = scale.hypot(filter);
        share *= if wide > 0.0 { scale / wide } else { 1.0 };
        *log = wide.ln() as f32;
    }
    splat.opacity_logit = logit((f64::from(opacity(splat.opacity_logit)) * share) as f32);
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
    write_filtered(cloud, background, None)
}

/// The same of a scene that is drawn with anti-aliasing: `filter` is the deviation of Mip-Splatting's filter of each Gaussian, which whoever
/// reads it applies to the scales and opacities, `filter_3D`.
///
/// # Errors
/// As [`write()`]; or there are not as many filters as Gaussians, or one is not finite.
pub fn write_filtered(
    cloud: &GaussianCloud,
    background: Option<[f32; 3]>,
    filter: Option<&[f32]>,
) -> Result<Vec<u8>, SplatError> {
    check(cloud)?;
    if let Some(filter) = filter.filter(|filter| filter.len() != cloud.len()) {
        return Err(off("filter_3D", format!("one for each of {} Gaussians", cloud.len()), filter.len()));
    }
    if let Some(odd) = filter.and_then(|filter| filter.iter().find(|width| !(width.is_finite() && **width >= 0.0))) {
        return Err(off("filter_3D", "a finite number of at least 0", odd));
    }
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
    names.extend(filter.map(|_| "filter_3D".to_string()));
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
        if let Some(filter) = filter {
            put(&[filter[i]]);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    /// A file of two Gaussians with further properties, little-endian floats.
    fn file(extra: &str, values: &[f32]) -> Vec<u8> {
        let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
        let lines: String =
            names.split(' ').chain(extra.split_whitespace()).map(|n| format!("property float {n}\n")).collect();
        let mut out =
            format!("ply\nformat binary_little_endian 1.0\nelement vertex 2\n{lines}end_header\n").into_bytes();
        for k in 0..2 {
            let row = [k as f32, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0, -1.0, -2.0, f32::NEG_INFINITY, 1.0, 0.0, 0.0, 0.0];
            row.iter().chain(values).for_each(|x| out.extend(x.to_le_bytes()));
        }
        out
    }

    #[test]
    fn the_filter_of_mip_splatting_is_applied() {
        let plain = read(&file("", &[])).unwrap();
        let none = read(&file("filter_3D", &[0.0])).unwrap();
        assert_eq!(none.cloud.log_scales[0][0], plain.cloud.log_scales[0][0]);
        assert_eq!((plain.remarks.len(), none.remarks.len(), none.lost.len()), (0, 1, 0));
        let filtered = read(&file("filter_3D", &[0.5])).unwrap().cloud;
        let scales = [(-1.0f64).exp(), (-2.0f64).exp(), 0.0];
        for k in 0..3 {
            let expected = (scales[k] * scales[k] + 0.25).sqrt().ln();
            assert!((f64::from(filtered.log_scales[0][k]) - expected).abs() < 1e-6);
        }
        // A disc without thickness that is made thick is thin in all directions: its opacity is spread over an infinite ratio.
        assert!(filtered.opacity_logits[0] < -16.0);
        let mut thick = file("filter_3D", &[0.5]);
        let at = thick.len() - 15 * 4 + 9 * 4;
        thick[at..at + 4].copy_from_slice(&0.0f32.to_le_bytes());
        let cloud = read(&thick).unwrap().cloud;
        let share: f64 = [scales[0], scales[1], 1.0].iter().map(|s| s / (s * s + 0.25).sqrt()).product();
        assert!((f64::from(opacity(cloud.opacity_logits[1])) - 0.5 * share).abs() < 1e-6);
        assert_eq!(read(&file("filter_3D", &[f32::NAN])).unwrap().left_out, 2);
    }

    #[test]
    fn a_filter_that_is_written_is_applied_when_it_is_read() {
        let cloud = read(&file("", &[])).unwrap().cloud;
        let again = read(&write_filtered(&cloud, None, Some(&[0.5, 0.0])).unwrap()).unwrap();
        let both = read(&file("filter_3D", &[0.5])).unwrap();
        assert!(again.antialias && both.antialias && !read(&write(&cloud).unwrap()).unwrap().antialias);
        assert_eq!(again.cloud.opacity_logits[0], both.cloud.opacity_logits[0]);
        assert_eq!(again.cloud.log_scales[0][..2], both.cloud.log_scales[0][..2]);
        assert_eq!(again.cloud.log_scales[1][..2], cloud.log_scales[1][..2]);
        let error = write_filtered(&cloud, None, Some(&[0.5])).unwrap_err().to_string();
        assert!(error.states("2 Gaussians"), "{error}");
        assert!(write_filtered(&cloud, None, Some(&[0.5, f32::NAN])).is_err());
    }

    #[test]
    fn a_stream_gives_what_the_bytes_give() {
        let bytes = file("filter_3D", &[0.1]);
        // One byte at a time.
        struct Slow<'a>(&'a [u8]);
        impl Read for Slow<'_> {
            fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
                let count = out.len().min(1);
                self.0.read(&mut out[..count])
            }
        }
        assert_eq!(read_stream(&mut Slow(&bytes), bytes.len() as u64), read(&bytes));
        let error = read_stream(&mut Slow(&bytes[..bytes.len() - 3]), bytes.len() as u64).unwrap_err().to_string();
        assert!(error.states("bytes"), "{error}");
    }
}
