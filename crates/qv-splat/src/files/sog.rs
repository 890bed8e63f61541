//! PlayCanvas' SOG (developer.playcanvas.com, *The SOG Format*, version 2; version 1 by playcanvas/splat-transform, `read-sog-v1.ts`).
//!
//! `meta.json` names images of 8 bits, lossless WebP by habit, in a ZIP archive or beside it. A pixel, row by row, is a Gaussian: positions in two
//! images, low and high bytes of 16 bits between the least and the largest of sign(x) ln(|x| + 1); rotation as three numbers within ±1/√2 beside
//! the largest, which alpha tells (252 w, 253 x, 254 y, 255 z); log scales and the constant harmonic as places in a table of 256 numbers; opacity in alpha.
//! Other harmonics are rows of a palette: `labels` has the row of each Gaussian, `centroids` 64 rows side by side. Version 1 has least and
//! largest numbers in place of the tables, and logits in place of opacities. The frame is that of the PLY that it was made of.

use super::quantised::{from_smallest_three, logit_of_byte};
use super::sieve::{Sieve, Splat};
use super::zip::Archive;
use super::{Beside, Format, SplatFile};
use crate::SplatError;
use crate::captures::json;
use crate::error::off;
use image::{ImageDecoder, ImageReader};
use serde_json::Value;

/// Rows of the palette that lie side by side in its image.
const SIDE_BY_SIDE: usize = 64;
/// Functions of the palette by degree.
const FUNCTIONS: [usize; 4] = [0, 3, 8, 15];
/// Images may decode to this many times the files' size, and to [`LEAST_LIMIT`] bytes anyhow.
const LARGEST_RATIO: u64 = 256;
const LEAST_LIMIT: u64 = 64 << 20;
/// Largest `meta.json`, bytes.
const LARGEST_META: u64 = 1 << 20;

/// Reads a bundle: `meta.json` and its images in a ZIP archive.
///
/// # Errors
/// As [`read_folder`], and the archive is damaged.
pub fn read(bytes: &[u8]) -> Result<SplatFile, SplatError> {
    let archive = Archive::open(bytes)?;
    let meta = archive.get("meta.json", LARGEST_META).map_err(|found| off("SOG", "meta.json", found))?;
    read_folder(&meta, &mut |name| archive.get(name, bytes.len() as u64))
}

/// Reads the text of `meta.json`, whose images `beside` gives.
///
/// # Errors
/// The version is another, an image is missing, no image of 8 bits, too small or far too large for the Gaussians that are claimed, or a table is off.
pub fn read_folder(meta: &[u8], beside: Beside) -> Result<SplatFile, SplatError> {
    let meta = json::parse(meta, "SOG, meta.json")?;
    let number = |value: Option<&Value>| value.and_then(Value::as_u64);
    let (count, is_first) = match meta.get("version") {
        None => (number(meta.pointer("/means/shape/0")), true),
        Some(version) if version == 2 => (number(meta.get("count")), false),
        Some(version) => return Err(off("SOG, version", "2, or none", version)),
    };
    let count = count.ok_or_else(|| off("SOG, meta.json", "the number of Gaussians", "none"))?;
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    let mut images = Images { meta: &meta, beside, count };
    let (low, high) = (images.get("means", 0)?, images.get("means", 1)?);
    let (rotations, scales, colours) = (images.get("quats", 0)?, images.get("scales", 0)?, images.get("sh0", 0)?);
    let means = Range::of(&meta, "means", 3)?;
    let log_scales = Numbers::of(&meta, "scales", 3, is_first)?;
    let constants = Numbers::of(&meta, "sh0", 4, is_first)?;
    let palette = Palette::of(&meta, &mut images, is_first)?;
    let functions = palette.as_ref().map_or(0, |palette| palette.functions);
    let mut sieve = Sieve::new(count, ((functions + 1) as f64).sqrt() as u8 - 1, 0);
    let mut sh = vec![[0.0; 3]; functions + 1];
    let mut unknown = 0;
    for i in 0..count {
        let [low, high, rotation, scale, colour] =
            [&low, &high, &rotations, &scales, &colours].map(|image| image.at(i));
        sh[0] = std::array::from_fn(|c| constants.value(c, colour[c]));
        if let Some(palette) = &palette {
            palette.fill(i, &mut sh[1..]);
        }
        // Other values of alpha stand for nothing.
        let largest = usize::from(rotation[3]).checked_sub(252);
        unknown += usize::from(largest.is_none());
        let part = |k: usize| (f32::from(rotation[k]) / 255.0 * 2.0 - 1.0) * std::f32::consts::FRAC_1_SQRT_2;
        sieve.push(&Splat {
            mean: std::array::from_fn(|k| means.position(k, u16::from_le_bytes([low[k], high[k]]))),
            log_scale: std::array::from_fn(|k| log_scales.value(k, scale[k])),
            rotation: largest.map_or([1.0, 0.0, 0.0, 0.0], |k| from_smallest_three(k, [part(0), part(1), part(2)])),
            opacity_logit: if is_first { constants.value(3, colour[3]) } else { logit_of_byte(colour[3]) },
            sh: &sh,
            features: &[],
        });
    }
    let lost = if unknown > 0 {
        vec![format!("rotations of {unknown} Gaussians, whose alpha stands for none")]
    } else {
        vec![]
    };
    Ok(sieve.finish(Format::Sog, lost))
}

/// An image, four bytes a pixel.
struct Pixels {
    width: usize,
    height: usize,
    rgba: Vec<u8>,
}

impl Pixels {
    fn at(&self, index: usize) -> [u8; 4] {
        std::array::from_fn(|k| self.rgba[4 * index + k])
    }
}

/// Gives the images that the document names.
struct Images<'a, 'b> {
    meta: &'a Value,
    beside: Beside<'b>,
    count: usize,
}

impl Images<'_, '_> {
    /// An image with a pixel for each Gaussian.
    fn get(&mut self, key: &str, index: usize) -> Result<Pixels, SplatError> {
        let image = self.decoded(key, index)?;
        if image.width * image.height < self.count {
            let found = format!("{} x {}", image.width, image.height);
            return Err(off(format!("SOG, {key}"), format!("a pixel for each of {} Gaussians", self.count), found));
        }
        Ok(image)
    }

    fn decoded(&mut self, key: &str, index: usize) -> Result<Pixels, SplatError> {
        let place = format!("SOG, {key}");
        let name = self.meta.get(key).and_then(|one| one.get("files")?.get(index)?.as_str());
        let name = name.ok_or_else(|| off(&*place, "the names of its images in `files`", "none"))?;
        if name.contains(['/', '\\']) {
            return Err(off(place, "the name of a file beside meta.json", name));
        }
        let bytes = (self.beside)(name).map_err(|found| off(format!("{place}, {name}"), "an image", found))?;
        let no_image = |found: image::ImageError| off(format!("{place}, {name}"), "an image", found);
        let reader = ImageReader::new(std::io::Cursor::new(&bytes)).with_guessed_format();
        let reader = reader.map_err(|found| off(format!("{place}, {name}"), "an image", found))?;
        let decoder = reader.into_decoder().map_err(no_image)?;
        let (width, height) = decoder.dimensions();
        let size = 4 * u64::from(width) * u64::from(height);
        let limit = (LARGEST_RATIO * bytes.len() as u64).max(LEAST_LIMIT);
        if size > limit {
            return Err(SplatError::TooLarge { place: format!("{place}, bytes of {name}"), limit, found: size });
        }
        let image = image::DynamicImage::from_decoder(decoder).map_err(no_image)?;
        if image.color().bits_per_pixel() > 32 {
            return Err(off(format!("{place}, {name}"), "8 bits a channel", format!("{:?}", image.color())));
        }
        Ok(Pixels { width: width as usize, height: height as usize, rgba: image.into_rgba8().into_raw() })
    }
}

/// Numbers of a list of the document.
fn list(meta: &Value, key: &str, name: &str, count: usize) -> Result<Vec<f32>, SplatError> {
    let found = meta.get(key).and_then(|one| one.get(name));
    // Of the harmonics' palette one number counts for all.
    let all = match found {
        Some(Value::Array(all)) => all.iter().map(|x| x.as_f64().map(|x| x as f32)).collect::<Option<Vec<f32>>>(),
        Some(Value::Number(one)) => one.as_f64().map(|x| vec![x as f32; count]),
        _ => None,
    };
    let all = all.filter(|all| all.len() >= count);
    all.ok_or_else(|| {
        off(format!("SOG, {key}.{name}"), format!("{count} numbers"), found.map_or("none".into(), shortened))
    })
}

fn shortened(value: &Value) -> String {
    value.to_string().chars().take(60).collect()
}

/// Least and largest numbers.
struct Range {
    low: Vec<f32>,
    high: Vec<f32>,
}

impl Range {
    fn of(meta: &Value, key: &str, count: usize) -> Result<Self, SplatError> {
        Ok(Self { low: list(meta, key, "mins", count)?, high: list(meta, key, "maxs", count)? })
    }

    fn at(&self, k: usize, share: f64) -> f64 {
        let (low, high) = (f64::from(self.low[k]), f64::from(self.high[k]));
        low + (high - low) * share
    }

    /// A coordinate from its 16 bits \[m\].
    fn position(&self, k: usize, step: u16) -> f32 {
        let log = self.at(k, f64::from(step) / 65535.0);
        (log.abs().exp_m1().copysign(log)) as f32
    }
}

/// What a byte stands for.
enum Numbers {
    Table(Vec<f32>),
    Between(Range),
}

impl Numbers {
    fn of(meta: &Value, key: &str, count: usize, is_first: bool) -> Result<Self, SplatError> {
        if is_first {
            return Ok(Self::Between(Range::of(meta, key, count)?));
        }
        let mut meta = meta.clone();
        // Early writers lost the first number of the table; PlayCanvas' engine puts it one step below the second.
        if let Some(Value::Array(table)) = meta.get_mut(key).and_then(|one| one.get_mut("codebook"))
            && let [Value::Null, second, .., last] = &table[..]
            && let (Some(second), Some(last)) = (second.as_f64(), last.as_f64())
        {
            table[0] = (second + (second - last) / 255.0).into();
        }
        Ok(Self::Table(list(&meta, key, "codebook", 256)?))
    }

    fn value(&self, k: usize, byte: u8) -> f32 {
        match self {
            Self::Table(table) => table[usize::from(byte)],
            Self::Between(range) => range.at(k, f64::from(byte) / 255.0) as f32,
        }
    }
}

/// Harmonics beyond the constant one.
struct Palette {
    functions: usize,
    centroids: Pixels,
    labels: Pixels,
    numbers: Numbers,
}

impl Palette {
    fn of(meta: &Value, images: &mut Images, is_first: bool) -> Result<Option<Self>, SplatError> {
        let Some(told) = meta.get("shN").filter(|told| !told.is_null()) else { return Ok(None) };
        let centroids = images.decoded("shN", 0)?;
        let labels = images.get("shN", 1)?;
        // Version 1 does not say the degree; the image's width does.
        let functions = match told.get("bands").and_then(Value::as_u64) {
            Some(bands) => FUNCTIONS.get(bands as usize).copied(),
            None => FUNCTIONS.iter().copied().find(|functions| centroids.width == SIDE_BY_SIDE * functions),
        };
        let Some(functions) = functions.filter(|functions| centroids.width == SIDE_BY_SIDE * functions) else {
            let expected = "64 rows of 3, 8 or 15 functions side by side";
            return Err(off("SOG, shN, centroids", expected, format!("{} columns", centroids.width)));
        };
        let numbers = Numbers::of(meta, "shN", 1, is_first)?;
        let palette = Self { functions, centroids, labels, numbers };
        let most = (0..images.count).map(|i| palette.label(i)).max().unwrap_or(0);
        let rows = SIDE_BY_SIDE * palette.centroids.height;
        if most >= rows {
            return Err(off("SOG, shN, labels", format!("rows of the palette below {rows}"), most));
        }
        Ok(Some(palette))
    }

    fn label(&self, index: usize) -> usize {
        let [low, high, ..] = self.labels.at(index);
        usize::from(u16::from_le_bytes([low, high]))
    }

    fn fill(&self, index: usize, sh: &mut [[f32; 3]]) {
        let label = self.label(index);
        let first = label / SIDE_BY_SIDE * self.centroids.width + label % SIDE_BY_SIDE * self.functions;
        for (k, colour) in sh.iter_mut().enumerate() {
            let pixel = self.centroids.at(first + k);
            *colour = std::array::from_fn(|c| self.numbers.value(0, pixel[c]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::files::quantised::opacity;
    use crate::files::zip::archive;
    use crate::files::{read_any, read_named};
    use serde_json::json;

    fn webp(width: u32, height: u32, pixels: &[[u8; 4]]) -> Vec<u8> {
        let mut out = vec![];
        let encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut out);
        let mut rgba = pixels.concat();
        rgba.resize((4 * width * height) as usize, 0);
        encoder.encode(&rgba, width, height, image::ExtendedColorType::Rgba8).unwrap();
        out
    }

    /// Three Gaussians in images of 2 x 2.
    fn members() -> Vec<(&'static str, Vec<u8>)> {
        let two = |pixels: [[u8; 4]; 3]| webp(2, 2, &pixels);
        let mut centroids = vec![[128, 128, 128, 255]; 64 * 3];
        centroids[3..6].copy_from_slice(&[[0, 1, 2, 255], [3, 4, 5, 255], [6, 7, 8, 255]]);
        vec![
            ("means_l.webp", two([[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 0, 255]])),
            ("means_u.webp", two([[0, 0, 0, 255], [255, 255, 255, 255], [0x80, 0, 0xff, 255]])),
            ("quats.webp", two([[128, 128, 128, 252], [255, 128, 128, 253], [128, 128, 0, 255]])),
            ("scales.webp", two([[0, 1, 255, 255]; 3])),
            ("sh0.webp", two([[0, 10, 255, 255], [0, 0, 0, 51], [0, 0, 0, 0]])),
            ("centroids.webp", webp(192, 1, &centroids)),
            ("labels.webp", two([[1, 0, 0, 255], [0, 0, 0, 255], [63, 0, 0, 255]])),
        ]
    }

    fn meta() -> Value {
        let table = |low: f64| (0..256).map(|k| low + k as f64 / 255.0).collect::<Vec<f64>>();
        json!({"version": 2, "count": 3, "means": {"mins": [-1.0, 0.0, 1.0], "maxs": [1.0, 2.0, 3.0], "files": ["means_l.webp", "means_u.webp"]},
            "quats": {"files": ["quats.webp"]}, "scales": {"codebook": table(-6.0), "files": ["scales.webp"]},
            "sh0": {"codebook": table(0.0), "files": ["sh0.webp"]},
            "shN": {"count": 64, "bands": 1, "codebook": table(-0.5), "files": ["centroids.webp", "labels.webp"]}})
    }

    fn bundle(meta: &Value, deflate: bool) -> Vec<u8> {
        let (text, members) = (meta.to_string(), members());
        let mut all: Vec<(&str, &[u8])> = members.iter().map(|(name, bytes)| (*name, &bytes[..])).collect();
        all.push(("meta.json", text.as_bytes()));
        archive(&all, deflate)
    }

    fn check(cloud: &qv_core::GaussianCloud) {
        let near = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 1e-5 * (1.0 + b.abs()), "{a} {b}");
        let e = std::f64::consts::E;
        [-(e - 1.0), 0.0, e - 1.0].iter().zip(cloud.means[0]).for_each(|(b, a)| near(a, *b));
        [e - 1.0, e.powi(2) - 1.0, e.powi(3) - 1.0].iter().zip(cloud.means[1]).for_each(|(b, a)| near(a, *b));
        near(cloud.means[2][2], (1.0 + 2.0 * f64::from(0xff00u16) / 65535.0).exp() - 1.0);
        let [w, x, ..] = cloud.rotations[1];
        near(w, 0.5f64.sqrt());
        assert!((x - 0.5f32.sqrt()).abs() < 0.01 && cloud.rotations[0][0] > 0.99);
        near(cloud.rotations[2][2], -(0.5f64.sqrt()));
        [-6.0, -6.0 + 1.0 / 255.0, -5.0].iter().zip(cloud.log_scales[0]).for_each(|(b, a)| near(a, *b));
        [0.0, 10.0 / 255.0, 1.0].iter().zip(cloud.sh_of(0)[0]).for_each(|(b, a)| near(a, *b));
        near(cloud.sh_of(0)[3][1], -0.5 + 7.0 / 255.0);
        near(cloud.sh_of(1)[1][0], -0.5 + 128.0 / 255.0);
    }

    #[test]
    fn bundles_and_folders_are_read() {
        for deflate in [false, true] {
            let file = read_any(&bundle(&meta(), deflate)).unwrap();
            assert_eq!((file.format, file.cloud.len(), file.cloud.sh_degree, file.lost.len()), (Format::Sog, 3, 1, 0));
            check(&file.cloud);
            assert!((opacity(file.cloud.opacity_logits[1]) - 0.2).abs() < 1e-6);
        }
        let members = members();
        let mut beside = |name: &str| {
            members.iter().find(|(known, _)| *known == name).map(|(_, bytes)| bytes.clone()).ok_or("gone".into())
        };
        check(&read_named(meta().to_string().as_bytes(), "meta.json", &mut beside).unwrap().cloud);
        let error = read_any(meta().to_string().as_bytes()).unwrap_err().to_string();
        assert!(error.states("SOG means_l.webp"), "{error}");
    }

    #[test]
    fn version_1_has_ranges() {
        let mut old = meta();
        old.as_object_mut().unwrap().remove("version");
        old["means"]["shape"] = json!([3, 3]);
        old["scales"] = json!({"mins": [-6.0, -6.0, -6.0], "maxs": [-5.0, -5.0, -5.0], "files": ["scales.webp"]});
        old["sh0"] = json!({"mins": [0.0, 0.0, 0.0, -2.0], "maxs": [1.0, 1.0, 1.0, 3.0], "files": ["sh0.webp"]});
        old["shN"] = json!({"mins": -0.5, "maxs": 0.5, "files": ["centroids.webp", "labels.webp"]});
        let cloud = read(&bundle(&old, false)).unwrap().cloud;
        check(&cloud);
        assert_eq!((cloud.opacity_logits[0], cloud.opacity_logits[2]), (3.0, -2.0));
    }

    #[test]
    fn each_fault_is_named() {
        let fault = |path: &str, value: Value| {
            let mut meta = meta();
            *meta.pointer_mut(path).unwrap() = value;
            read(&bundle(&meta, false)).unwrap_err().to_string()
        };
        assert!(fault("/version", json!(3)).states("SOG 2 3"));
        assert!(fault("/count", json!(5)).states("5 Gaussians 2 2"));
        assert!(fault("/count", json!(u64::MAX)).states("pixel"));
        assert!(fault("/means/mins", json!([1, 2])).states("SOG means.mins 3"));
        assert!(fault("/scales/codebook", json!([1])).states("SOG scales.codebook 256"));
        assert!(fault("/quats/files", json!([])).states("SOG"));
        assert!(fault("/quats/files", json!(["../x"])).states("meta.json ../x"));
        assert!(fault("/quats/files", json!(["meta.json"])).states("SOG meta.json"));
        assert!(fault("/shN/bands", json!(2)).states("columns 192"));
        let mut first_lost = meta();
        first_lost["scales"]["codebook"][0] = Value::Null;
        let cloud = read(&bundle(&first_lost, false)).unwrap().cloud;
        assert!((cloud.log_scales[0][0] + 6.0).abs() < 1e-4, "{:?}", cloud.log_scales[0]);
        let good = bundle(&meta(), false);
        for length in (0..good.len()).step_by(37) {
            assert!(read(&good[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn damaged_files_give_words_or_good_gaussians() {
        let good = bundle(&meta(), true);
        for at in 0..good.len() {
            let mut bytes = good.clone();
            bytes[at] ^= 1 << (at % 8);
            match read(&bytes) {
                Ok(file) => assert_eq!(file.cloud.check(), Ok(()), "byte {at}"),
                Err(error) => assert!(error.to_string().contains("expected"), "{error}"),
            }
        }
    }
}
