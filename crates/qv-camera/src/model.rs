//! What all photographs are off by together: one camera, one clock, one exposure, one place of the scene.
//!
//! Stage two of the diagnosis. The offsets of each photograph (`align`) are data. A model foretells them from 17 numbers that all
//! photographs share; what it misses is noise with heavy tails (Student's t; Lange, Little and Taylor 1989) whose size is that of the
//! scatter from photograph to photograph. Models differ in which numbers have a wide prior, and are compared by Laplace's
//! approximation of the evidence, -E - ln|P|/2 - ln|H|/2, as the other effects are (`evidence`).

use crate::align::{GEOMETRY, NUMBERS, Numbers, Offsets};
use crate::path::{Path, pose_of, twist_of};
use qv_core::Pose;
use qv_core::statistics::median;
use qv_fit::linear::{add_diagonal, diagonal_of, squared};
use qv_fit::{Blocks, Cholesky, Differences, FitError, Loss, Matrix, Options, Problem, slopes};

/// Shared numbers: mounting of the camera (translation \[m\], rotation \[rad\], in camera axes), delay \[s\], logarithm of the gain, offset
/// of displayed values, logarithm of the focal length, variance of a blur \[px²\], and the place of the scene in the world (translation
/// \[m\], rotation \[rad\], about the middle of the path).
pub const SHARED: usize = 17;
/// First number of each kind.
pub(crate) const MOUNTING: usize = 0;
/// Of the delay.
pub const DELAY: usize = 6;
/// Of the gain.
pub(crate) const GAIN: usize = 7;
/// Of the offset of values.
pub(crate) const BIAS: usize = 8;
/// Of the focal length.
pub const FOCAL: usize = 9;
/// Of the blur.
pub(crate) const BLUR: usize = 10;
/// Of the place of the scene.
pub const PLACE: usize = 11;

/// What any camera is off by without a name for it.
pub const TOLERANCE: [f64; SHARED] = [
    0.006, 0.006, 0.006, 0.002, 0.002, 0.002, // mounting
    0.002, 0.03, 0.02, 0.004, 0.3, // delay, gain, bias, focal, blur
    0.015, 0.015, 0.015, 0.003, 0.003, 0.003, // scene
];
/// Deviation of the prior of what is suspected.
pub const WIDE: [f64; SHARED] = [
    0.05, 0.05, 0.05, 0.04, 0.04, 0.04, //
    0.06, 0.5, 0.05, 0.08, 2.0, //
    0.05, 0.05, 0.05, 0.03, 0.03, 0.03,
];
/// Deviations that poses and pictures have at least from photograph to photograph, whatever alignment says.
const LEAST: [f64; NUMBERS] = [0.003, 0.003, 0.003, 0.001, 0.001, 0.001, 0.002, 0.08, 0.01, 0.005];
/// Which numbers of a photograph share a size of noise: pose, focal length, blur, gain, offset.
const GROUP: [usize; NUMBERS] = [0, 0, 0, 0, 0, 0, 1, 2, 3, 4];
const GROUPS: usize = 5;
/// Degrees of freedom of the noise.
const TAILS: f64 = 4.0;
/// Few photographs may agree by chance.
const LEAST_SCALE: f64 = 0.7;
/// Median of the square of a deviate of Student's t with four degrees of freedom.
const MEDIAN_SQUARE: f64 = 0.5486;

/// How much a number is moved for its slope; the delay by more, as a path is known at moments only.
const STEP: f64 = 1e-4;
const STEP_OF_DELAY: f64 = 0.004;
/// Noise of geometry and of brightness, each with tails of its own.
const LOSS: Loss = Loss::student(TAILS);

/// A photograph's place and what it is off by.
#[derive(Debug, Clone)]
pub struct Sighting {
    /// Stamp \[s\].
    pub time: f64,
    /// What it is off by.
    pub offsets: Offsets,
    /// Covariance by the picture alone, what poses scatter at least included.
    pub covariance: Matrix,
}

impl Sighting {
    /// Of an alignment.
    pub fn new(time: f64, offsets: Offsets, information: &Matrix) -> Option<Self> {
        let mut covariance = Cholesky::new(information)?.inverse();
        add_diagonal(&mut covariance, &LEAST.map(|d| d * d));
        diagonal_of(&covariance).iter().all(|x| x.is_finite()).then_some(Self { time, offsets, covariance })
    }
}

/// Where the camera should have been, and photographs that were taken.
pub struct Together<'a> {
    /// The measured path.
    pub path: &'a Path,
    /// `base_from_camera` as stated.
    pub base_from_camera: Pose,
    /// Delay as stated \[s\].
    pub delay: f64,
    /// Middle of the path \[m\]: scenes turn about it.
    pub middle: Pose,
    /// Photographs.
    pub sightings: &'a [Sighting],
    /// Size of the noise of each group, in units of what the alignment says.
    pub scales: [f64; GROUPS],
}

/// A fit of the shared numbers.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The shared numbers.
    pub shared: [f64; SHARED],
    /// Their deviations.
    pub deviations: [f64; SHARED],
    /// Log evidence.
    pub evidence: f64,
    /// Mean square of what photographs are off by, in units of noise and priors together; outliers count as their weight says.
    pub level: f64,
}

impl<'a> Together<'a> {
    /// Sizes of the noise are those of the scatter about the fit in which everything is wide.
    pub fn new(path: &'a Path, base_from_camera: Pose, delay: f64, sightings: &'a [Sighting]) -> Option<Self> {
        let mean = |k: usize| {
            let sum: f64 = sightings.iter().map(|s| path.at(s.time).position[k]).sum();
            sum / sightings.len().max(1) as f64
        };
        let middle = Pose { position: glam::DVec3::new(mean(0), mean(1), mean(2)), ..Pose::IDENTITY };
        let mut together = Self { path, base_from_camera, delay, middle, sightings, scales: [1.0; GROUPS] };
        for _ in 0..4 {
            let fit = together.fit(&(0..SHARED).collect::<Vec<_>>(), &[[0.0; SHARED]], |_| true)?;
            together.rescale(&fit.shared);
        }
        Some(together)
    }

    /// `camera_from_world` where everything is as stated.
    pub fn nominal(&self, time: f64) -> Pose {
        (self.path.at(time - self.delay) * self.base_from_camera).inverse()
    }

    /// What the model foretells of a photograph.
    pub fn predicted(&self, shared: &[f64; SHARED], time: f64) -> Offsets {
        let place = self.middle * pose_of(&shared[PLACE..PLACE + 6]) * self.middle.inverse();
        let camera_from_world = pose_of(&shared[..6]) * self.nominal(time - shared[DELAY]) * place;
        Offsets {
            camera_from_nominal: camera_from_world * self.nominal(time).inverse(),
            focal: shared[FOCAL],
            blur: shared[BLUR],
            gain: shared[GAIN],
            bias: shared[BIAS],
        }
    }

    fn residual(&self, shared: &[f64; SHARED], sighting: &Sighting) -> Numbers {
        let (seen, predicted) = (&sighting.offsets, self.predicted(shared, sighting.time));
        let pose = twist_of(&(seen.camera_from_nominal * predicted.camera_from_nominal.inverse()));
        let [a, b, c, d, e, f] = pose;
        let (focal, blur) = (seen.focal - predicted.focal, seen.blur - predicted.blur);
        [a, b, c, d, e, f, focal, blur, seen.gain - predicted.gain, seen.bias - predicted.bias]
    }

    /// Factors of the covariances of geometry and of brightness with the sizes of the noise; what they share is left out, as each has tails of
    /// its own.
    fn factors(&self, sighting: &Sighting) -> Option<[Cholesky; 2]> {
        let of = |first: usize, count: usize| {
            let scale = |i: usize| self.scales[GROUP[first + i]];
            let one = |i: usize, k: usize| scale(i) * scale(k) * sighting.covariance[(first + i, first + k)];
            Cholesky::new(&Matrix::from_fn(count, count, one))
        };
        Some([of(0, GEOMETRY)?, of(GEOMETRY, NUMBERS - GEOMETRY)?])
    }

    /// Residuals of photographs in units of their noise at each of some shared numbers: geometry and brightness of each, block by block.
    fn blocks(&self, points: &[Vec<f64>], taken: &[(&Sighting, [Cholesky; 2])]) -> Vec<Blocks> {
        let of_photograph = |shared: &[f64; SHARED], (sighting, factors): &(&Sighting, [Cholesky; 2])| {
            let all = self.residual(shared, sighting);
            let mut parts = [all[..GEOMETRY].to_vec(), all[GEOMETRY..].to_vec()];
            factors.iter().zip(&mut parts).for_each(|(factor, part)| factor.whiten(part));
            parts
        };
        let of_point = |p: &Vec<f64>| {
            let shared: [f64; SHARED] = std::array::from_fn(|i| p[i]);
            taken.iter().flat_map(|t| of_photograph(&shared, t)).collect()
        };
        points.iter().map(of_point).collect()
    }

    fn rescale(&mut self, shared: &[f64; SHARED]) {
        let residuals: Vec<Numbers> = self.sightings.iter().map(|s| self.residual(shared, s)).collect();
        for group in 0..GROUPS {
            let of: Vec<usize> = (0..NUMBERS).filter(|&i| GROUP[i] == group).collect();
            let mut squares: Vec<f64> = self
                .sightings
                .iter()
                .zip(&residuals)
                .flat_map(|(s, r)| of.iter().map(|&i| r[i] * r[i] / s.covariance[(i, i)]))
                .collect();
            // Each kind of number is fitted by as many shared ones: mounting, delay and place for poses, one for each other.
            let fitted = if group == 0 { 13.0 } else { 1.0 };
            let count = squares.len() as f64;
            let left = (count - fitted).max(0.4 * count);
            if squares.is_empty() {
                continue;
            }
            self.scales[group] = (median(&mut squares) / MEDIAN_SQUARE * count / left).sqrt().max(LEAST_SCALE);
        }
    }

    /// The best fit with wide priors for `wide` among `starts`, over the photographs that `take` names by index.
    pub fn fit(&self, wide: &[usize], starts: &[[f64; SHARED]], take: impl Fn(usize) -> bool) -> Option<Fit> {
        let mut prior = TOLERANCE;
        wide.iter().for_each(|&i| prior[i] = WIDE[i]);
        let some = self.sightings.iter().enumerate().filter(|(i, _)| take(*i));
        let taken: Vec<(&Sighting, [Cholesky; 2])> =
            some.map(|(_, s)| self.factors(s).map(|f| (s, f))).collect::<Option<_>>()?;
        let fits = starts.iter().filter_map(|start| self.descend(start, &prior, &taken));
        fits.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    fn descend(
        &self,
        start: &[f64; SHARED],
        prior: &[f64; SHARED],
        taken: &[(&Sighting, [Cholesky; 2])],
    ) -> Option<Fit> {
        let mut step = [STEP; SHARED];
        step[DELAY] = STEP_OF_DELAY;
        let problem = Problem {
            prior: prior.iter().map(|p| Some([0.0, *p])).collect(),
            differences: Differences::Central,
            ..Problem::new(start, &step)
        };
        let mut residuals = |points: &[Vec<f64>]| -> Result<_, FitError> { Ok(self.blocks(points, taken)) };
        let options = Options { loss: LOSS, rounds: 40, gain: 1e-7, fall: 0.0, ..Options::default() };
        let found = qv_fit::fit(&problem, &options, &mut residuals).ok()?;
        let factor = Cholesky::new(&slopes(&problem, &LOSS, &found.values, &mut residuals).ok()?.curvature)?;
        let covariance = factor.inverse();
        let evidence = -found.cost - 0.5 * factor.log_determinant() - prior.iter().map(|p| p.ln()).sum::<f64>();
        // As of a Gaussian with the tolerances in its covariance: what tolerated deviations have to do for the fit counts, too.
        let of_prior = 2.0 * problem.prior_cost(&found.values);
        let squares: f64 = found.residuals.iter().map(|r| LOSS.weight(r) * squared(r)).sum();
        let level = (of_prior + squares) / (NUMBERS * taken.len().max(1)) as f64;
        let shared = std::array::from_fn(|i| found.values[i]);
        let deviations = std::array::from_fn(|i| covariance[(i, i)].max(0.0).sqrt());
        evidence.is_finite().then_some(Fit { shared, deviations, evidence, level })
    }
}
