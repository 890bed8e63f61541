//! What is learned, with the optimiser's memory: all that a checkpoint holds.

use super::dataset::Dataset;
use super::exposure::{Exposure, NEUTRAL};
use super::shared;
use super::shared::SharedAppearance;
use super::transients::Mask;
use crate::SplatError;
use crate::error::off;
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::Gradients;

const PLACE: &str = "model to go on with";
/// How far from where a photograph was taken it may be said to have been taken: in metres, and where poses were refined in extents.
const SAME_PLACE: f64 = 1e-6;
const REFINED_FAR: f64 = 0.3;

/// The state of training after some steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Steps that were taken.
    pub iteration: u32,
    /// The Gaussians.
    pub cloud: GaussianCloud,
    /// Running means of derivatives; those of poses by photograph.
    pub first: Gradients,
    /// Running means of their squares.
    pub second: Gradients,
    /// Exposure of each photograph to learn from.
    pub exposures: Vec<Exposure>,
    /// Running means of their derivatives.
    pub exposures_first: Vec<Exposure>,
    /// Running means of the squares.
    pub exposures_second: Vec<Exposure>,
    /// `camera_from_world` of each photograph to learn from.
    pub poses: Vec<Pose>,
    /// Which camera took each photograph.
    pub groups: Vec<usize>,
    /// What photographs of one camera share.
    pub shared: Vec<SharedAppearance>,
    /// What is left out of each photograph to learn from; nothing before what moves was looked for.
    pub masks: Vec<Mask>,
}

impl Model {
    /// Nothing learned yet.
    pub fn new(cloud: GaussianCloud, dataset: &Dataset) -> Self {
        let views = dataset.training.len();
        let zeros = Gradients::zeros(&cloud, views);
        let groups = shared::groups(dataset);
        Self {
            iteration: 0,
            first: zeros.clone(),
            second: zeros,
            exposures: vec![NEUTRAL; views],
            exposures_first: vec![[0.0; 12]; views],
            exposures_second: vec![[0.0; 12]; views],
            poses: dataset.training.iter().map(|one| one.camera.camera_from_world).collect(),
            shared: vec![SharedAppearance::NONE; groups.iter().max().map_or(0, |last| last + 1)],
            groups,
            masks: vec![],
            cloud,
        }
    }

    /// Checks that this is of as many photographs.
    ///
    /// # Errors
    /// It is of more or fewer.
    pub fn check(&self, dataset: &Dataset) -> Result<(), SplatError> {
        let count = dataset.training.len();
        if self.exposures.len() != count || self.poses.len() != count {
            let expected = format!("{count} images, as the capture has");
            return Err(off(PLACE, expected, self.exposures.len()));
        }
        Ok(())
    }

    /// Checks that this was learned of these photographs: they were taken from where its own were. Poses that were refined may have moved.
    ///
    /// # Errors
    /// Names the first photograph that was taken from elsewhere.
    pub fn check_places(&self, dataset: &Dataset) -> Result<(), SplatError> {
        self.check(dataset)?;
        let refined = self.first.poses.as_flattened().iter().any(|mean| *mean != 0.0);
        let far = if refined { REFINED_FAR * f64::from(dataset.extent) } else { SAME_PLACE };
        for (one, pose) in dataset.training.iter().zip(&self.poses) {
            let (there, here) = (one.camera.camera_from_world.inverse().position, pose.inverse().position);
            if here.distance(there) > far {
                let name = format!("{PLACE}, image {}", one.name);
                return Err(off(name, format!("one taken from {there:.3}, as the capture has"), format!("{here:.3}")));
            }
        }
        Ok(())
    }

    /// The camera of a photograph to learn from, as it is now.
    pub fn camera(&self, dataset: &Dataset, photograph: usize) -> Camera {
        Camera { camera_from_world: self.poses[photograph], ..dataset.training[photograph].camera }
    }

    /// Makes room for harmonics of a higher degree, which begin at 0.
    pub(crate) fn raise_degree(&mut self, degree: u8) {
        let (old, new) = (self.cloud.sh_count(), (degree as usize + 1).pow(2));
        if new <= old {
            return;
        }
        for list in [&mut self.cloud.sh, &mut self.first.sh, &mut self.second.sh] {
            let mut wide = Vec::with_capacity(list.len() / old * new);
            for some in list.chunks_exact(old) {
                wide.extend_from_slice(some);
                wide.resize(wide.len() + new - old, [0.0; 3]);
            }
            *list = wide;
        }
        self.cloud.sh_degree = degree;
    }

    /// Puts a copy of Gaussian `source` at `target`, which is an index that there is, or the next one. The optimiser forgets what it
    /// knew of `target`.
    pub fn copy(&mut self, target: usize, source: usize) {
        fn put<T: Copy>(list: &mut Vec<T>, target: usize, source: usize, each: usize) {
            let from = source * each;
            if list.len() <= target * each {
                list.extend_from_within(from..from + each);
            } else {
                list.copy_within(from..from + each, target * each);
            }
        }
        let (sh, features) = (self.cloud.sh_count(), self.cloud.feature_count);
        let cloud = &mut self.cloud;
        put(&mut cloud.means, target, source, 1);
        put(&mut cloud.log_scales, target, source, 1);
        put(&mut cloud.rotations, target, source, 1);
        put(&mut cloud.opacity_logits, target, source, 1);
        put(&mut cloud.sh, target, source, sh);
        put(&mut cloud.features, target, source, features);
        for moments in [&mut self.first, &mut self.second] {
            put(&mut moments.means, target, source, 1);
            put(&mut moments.log_scales, target, source, 1);
            put(&mut moments.rotations, target, source, 1);
            put(&mut moments.opacity_logits, target, source, 1);
            put(&mut moments.sh, target, source, sh);
            put(&mut moments.features, target, source, features);
        }
        self.forget(target);
    }

    /// The optimiser forgets what it knew of a Gaussian.
    pub fn forget(&mut self, index: usize) {
        let (sh, features) = (self.cloud.sh_count(), self.cloud.feature_count);
        for moments in [&mut self.first, &mut self.second] {
            moments.means[index] = [0.0; 3];
            moments.log_scales[index] = [0.0; 3];
            moments.rotations[index] = [0.0; 4];
            moments.opacity_logits[index] = 0.0;
            moments.sh[index * sh..(index + 1) * sh].fill([0.0; 3]);
            moments.features[index * features..(index + 1) * features].fill(0.0);
        }
    }

    /// Leaves only Gaussians for which `stay` is true.
    pub fn retain(&mut self, stay: &[bool]) {
        fn keep<T: Copy>(list: &mut Vec<T>, stay: &[bool], each: usize) {
            let mut index = 0;
            list.retain(|_| {
                index += 1;
                stay[(index - 1) / each]
            });
        }
        let (sh, features) = (self.cloud.sh_count(), self.cloud.feature_count.max(1));
        let cloud = &mut self.cloud;
        keep(&mut cloud.means, stay, 1);
        keep(&mut cloud.log_scales, stay, 1);
        keep(&mut cloud.rotations, stay, 1);
        keep(&mut cloud.opacity_logits, stay, 1);
        keep(&mut cloud.sh, stay, sh);
        keep(&mut cloud.features, stay, features);
        for moments in [&mut self.first, &mut self.second] {
            keep(&mut moments.means, stay, 1);
            keep(&mut moments.log_scales, stay, 1);
            keep(&mut moments.rotations, stay, 1);
            keep(&mut moments.opacity_logits, stay, 1);
            keep(&mut moments.sh, stay, sh);
            keep(&mut moments.features, stay, features);
        }
    }
}
