//! A model as bytes and back: all that is needed to go on as if nothing had happened.
//!
//! Little-endian: the eight bytes `qvtrain5`; eight counts of 32 bits (steps, Gaussians, degree, features, photographs, cameras, bytes of text, bytes of masks); then floats: the
//! cloud's means, log scales, rotations, logits, harmonics, features; the same of both running means, each with that of poses; exposures and their running means;
//! of each camera running means (6 and 6); then as 32 bits each the camera of each photograph,
//! and how often each camera was seen; then poses of photographs and motions of cameras as seven doubles each, position and quaternion w, x, y, z; then
//! masks, of each its cells in a row and its rows as 32 bits each and a byte for each cell; then the text, UTF-8: what the caller says of the training, such as its options.

use super::model::Model;
use super::shared::SharedAppearance;
use super::transients::Mask;
use crate::SplatError;
use crate::error::off;
use qv_core::{GaussianCloud, Pose};
use qv_raster::Gradients;

const MAGIC: &[u8; 8] = b"qvtrain5";
const PLACE: &str = "checkpoint";

/// Bytes before the floats.
const HEAD: usize = 40;

/// Writes a model with what the caller says of its training.
pub fn write(model: &Model, text: &str) -> Vec<u8> {
    let cloud = &model.cloud;
    let mut out = MAGIC.to_vec();
    let masks = bytes_of_masks(&model.masks);
    let counts = [model.iteration, cloud.len() as u32, cloud.sh_degree as u32, cloud.feature_count as u32];
    counts
        .iter()
        .chain(&[model.poses.len() as u32, model.shared.len() as u32, text.len() as u32, masks.len() as u32])
        .for_each(|count| out.extend(count.to_le_bytes()));
    let mut floats = |list: &[f32]| list.iter().for_each(|x| out.extend(x.to_le_bytes()));
    floats(cloud.means.as_flattened());
    floats(cloud.log_scales.as_flattened());
    floats(cloud.rotations.as_flattened());
    floats(&cloud.opacity_logits);
    floats(cloud.sh.as_flattened());
    floats(&cloud.features);
    for moments in [&model.first, &model.second] {
        floats(moments.means.as_flattened());
        floats(moments.log_scales.as_flattened());
        floats(moments.rotations.as_flattened());
        floats(&moments.opacity_logits);
        floats(moments.sh.as_flattened());
        floats(&moments.features);
        floats(moments.poses.as_flattened());
    }
    for exposures in [&model.exposures, &model.exposures_first, &model.exposures_second] {
        floats(exposures.as_flattened());
    }
    for one in &model.shared {
        floats(&one.first);
        floats(&one.second);
    }
    let words = model.groups.iter().map(|group| *group as u32).chain(model.shared.iter().map(|one| one.seen));
    words.for_each(|word| out.extend(word.to_le_bytes()));
    for pose in model.poses.iter().chain(model.shared.iter().map(|one| &one.motion)) {
        let numbers = pose.position.to_array().into_iter().chain(pose.wxyz());
        numbers.for_each(|x| out.extend(x.to_le_bytes()));
    }
    out.extend(masks);
    out.extend(text.as_bytes());
    out
}

fn bytes_of_masks(masks: &[Mask]) -> Vec<u8> {
    let mut out = vec![];
    for mask in masks {
        out.extend((mask.width as u32).to_le_bytes());
        out.extend((mask.height as u32).to_le_bytes());
        out.extend(mask.cells.iter().map(|cell| u8::from(*cell)));
    }
    out
}

fn read_masks(mut bytes: &[u8], views: usize) -> Result<Vec<Mask>, SplatError> {
    let mut masks = vec![];
    while let Some((head, rest)) = bytes.split_first_chunk::<8>() {
        let [width, height] =
            [0, 4].map(|at| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize);
        let count = width.saturating_mul(height);
        if count > rest.len() {
            return Err(off(PLACE, format!("a mask of {width} x {height} cells"), format!("{} bytes", rest.len())));
        }
        let (cells, rest) = rest.split_at(count);
        masks.push(Mask { width, height, cells: cells.iter().map(|cell| *cell != 0).collect() });
        bytes = rest;
    }
    match bytes.is_empty() && (masks.is_empty() || masks.len() == views) {
        true => Ok(masks),
        false => Err(off(PLACE, format!("masks of {views} images"), masks.len())),
    }
}

/// What is left of the bytes.
struct Rest<'a>(&'a [u8]);

impl Rest<'_> {
    fn floats(&mut self, count: usize) -> Vec<f32> {
        let (now, rest) = self.0.split_at(4 * count);
        self.0 = rest;
        now.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    }

    fn words(&mut self, count: usize) -> Vec<u32> {
        self.floats(count).into_iter().map(f32::to_bits).collect()
    }

    fn rows<const N: usize>(&mut self, count: usize) -> Vec<[f32; N]> {
        self.floats(N * count).as_chunks().0.to_vec()
    }
}

/// Reads a model and what was said of its training.
///
/// # Errors
/// The bytes are none of a checkpoint, or their number is another than their counts say.
pub fn read(bytes: &[u8]) -> Result<(Model, String), SplatError> {
    if bytes.len() < HEAD || &bytes[..8] != MAGIC {
        return Err(off(PLACE, "the bytes `qvtrain5` and eight counts", format!("{} bytes", bytes.len())));
    }
    let count = |k: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| bytes[8 + 4 * k + i])) as usize;
    let (n, degree, features, views, lenses) = (count(1), count(2), count(3), count(4), count(5));
    if degree > 3 || features > GaussianCloud::MAX_FEATURES {
        let expected = "a degree of at most 3 and at most 16 features";
        return Err(off(PLACE, expected, format!("{degree} and {features}")));
    }
    let sh = (degree + 1).pow(2);
    let each = 11 + 3 * sh + features;
    let (said, masked) = (count(6), count(7));
    let expected = HEAD as u128
        + 4 * (n as u128 * (3 * each) as u128 + views as u128 * 49 + lenses as u128 * 13)
        + 56 * (views + lenses) as u128
        + said as u128
        + masked as u128;
    if expected != bytes.len() as u128 {
        return Err(off(PLACE, format!("{expected} bytes for {n} Gaussians"), bytes.len()));
    }
    let (rest, text) = bytes[HEAD..].split_at(bytes.len() - HEAD - said);
    let (numbers, masks) = rest.split_at(rest.len() - masked);
    let masks = read_masks(masks, views)?;
    let text = str::from_utf8(text).map_err(|e| off(PLACE, "text in UTF-8", e))?;
    let mut rest = Rest(numbers);
    let cloud = GaussianCloud {
        means: rest.rows(n),
        log_scales: rest.rows(n),
        rotations: rest.rows(n),
        opacity_logits: rest.floats(n),
        sh_degree: degree as u8,
        sh: rest.rows(n * sh),
        feature_count: features,
        features: rest.floats(n * features),
    };
    let mut moments = || Gradients {
        means: rest.rows(n),
        log_scales: rest.rows(n),
        rotations: rest.rows(n),
        opacity_logits: rest.floats(n),
        sh: rest.rows(n * sh),
        features: rest.floats(n * features),
        poses: rest.rows(views),
    };
    let (first, second) = (moments(), moments());
    let (exposures, exposures_first, exposures_second) = (rest.rows(views), rest.rows(views), rest.rows(views));
    let learned: Vec<[f32; 12]> = rest.rows(lenses);
    let groups: Vec<usize> = rest.words(views).into_iter().map(|group| group as usize).collect();
    if let Some(group) = groups.iter().find(|group| **group >= lenses) {
        return Err(off(PLACE, format!("images of {lenses} cameras"), format!("one of camera {group}")));
    }
    let seen = rest.words(lenses);
    let numbers: Vec<f64> = rest.0.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let pose = |x: &[f64; 7]| Pose {
        position: glam::DVec3::new(x[0], x[1], x[2]),
        rotation: glam::DQuat::from_xyzw(x[4], x[5], x[6], x[3]),
    };
    let all: Vec<Pose> = numbers.as_chunks().0.iter().map(pose).collect();
    let (poses, mountings) = all.split_at(views);
    let shared = learned.iter().zip(seen).zip(mountings).map(|((one, seen), motion)| SharedAppearance {
        first: std::array::from_fn(|k| one[k]),
        second: std::array::from_fn(|k| one[6 + k]),
        motion: *motion,
        seen,
    });
    let (shared, poses) = (shared.collect(), poses.to_vec());
    let iteration = count(0) as u32;
    let model = Model {
        iteration,
        cloud,
        first,
        second,
        exposures,
        exposures_first,
        exposures_second,
        poses,
        groups,
        shared,
        masks,
    };
    Ok((model, text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::super::tiny;
    use super::*;
    use crate::facts::States;

    #[test]
    fn what_is_written_is_read_and_faults_are_named() {
        let scene = tiny::scene(5, 3, 16);
        let mut model = Model::new(scene.cloud, &scene.dataset);
        model.raise_degree(2);
        model.iteration = 77;
        model.first.sh[3] = [1.0, 2.0, 3.0];
        model.shared[0] =
            SharedAppearance { second: [0.4; 6], seen: 5, motion: model.poses[1], ..SharedAppearance::NONE };
        let mask = Mask { width: 2, height: 1, cells: vec![true, false] };
        model.masks = vec![mask.clone(), Mask::default(), mask];
        let bytes = write(&model, "seed 2");
        assert_eq!(read(&bytes), Ok((model, "seed 2".into())));
        assert!(read(&bytes[..bytes.len() - 1]).unwrap_err().to_string().states("5 Gaussians"));
        assert!(read(b"hello").is_err());
        let mut huge = bytes;
        huge[12..16].fill(0xff);
        assert!(read(&huge).unwrap_err().to_string().states("4294967295 Gaussians"));
    }
}
