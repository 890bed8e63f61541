//! What all photographs are off by together: one camera, one clock, one exposure, one place of the scene.
//!
//! Stage two of the diagnosis. The offsets of each photograph (`align`) are data. A model foretells them from 17 numbers that all
//! photographs share; what it misses is noise with heavy tails (Student's t; Lange, Little and Taylor 1989) whose size is that of the
//! scatter from photograph to photograph. Models differ in which numbers have a wide prior, and are compared by Laplace's
//! approximation of the evidence, -E - ln|P|/2 - ln|H|/2, as the other effects are (`evidence`).

use crate::align::{GEOMETRY, Information, NUMBERS, Offsets};
use crate::path::{Path, pose_of, twist_of};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use qv_core::Pose;
use qv_core::statistics::median;

/// Shared numbers: mounting of the camera (translation \[m\], rotation \[rad\], in camera axes), delay \[s\], logarithm of the gain, offset
/// of displayed values, logarithm of the focal length, variance of a blur \[px²\], and the place of the scene in the world (translation
/// \[m\], rotation \[rad\], about the middle of the path).
pub const SHARED: usize = 17;
/// First number of each kind.
pub const MOUNTING: usize = 0;
/// Of the delay.
pub const DELAY: usize = 6;
/// Of the gain.
pub const GAIN: usize = 7;
/// Of the offset of values.
pub const BIAS: usize = 8;
/// Of the focal length.
pub const FOCAL: usize = 9;
/// Of the blur.
pub const BLUR: usize = 10;
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

type Numbers = SVector<f64, NUMBERS>;

/// A photograph's place and what it is off by.
#[derive(Debug, Clone)]
pub struct Sighting {
    /// Stamp \[s\].
    pub time: f64,
    /// What it is off by.
    pub offsets: Offsets,
    /// Covariance by the picture alone, what poses scatter at least included.
    pub covariance: SMatrix<f64, NUMBERS, NUMBERS>,
}

impl Sighting {
    /// Of an alignment.
    pub fn new(time: f64, offsets: Offsets, information: &Information) -> Option<Self> {
        let mut covariance = information.try_inverse()?;
        (0..NUMBERS).for_each(|i| covariance[(i, i)] += LEAST[i] * LEAST[i]);
        covariance.iter().all(|x| x.is_finite()).then_some(Self { time, offsets, covariance })
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
    pub fn foretold(&self, shared: &[f64; SHARED], time: f64) -> Offsets {
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
        let (seen, foretold) = (&sighting.offsets, self.foretold(shared, sighting.time));
        let pose = twist_of(&(seen.camera_from_nominal * foretold.camera_from_nominal.inverse()));
        let mut out = Numbers::zeros();
        (0..6).for_each(|i| out[i] = pose[i]);
        out[6] = seen.focal - foretold.focal;
        out[7] = seen.blur - foretold.blur;
        out[8] = seen.gain - foretold.gain;
        out[9] = seen.bias - foretold.bias;
        out
    }

    /// Covariance with the sizes of the noise; what geometry and brightness share is left out, as each has tails of its own.
    fn covariance(&self, sighting: &Sighting) -> SMatrix<f64, NUMBERS, NUMBERS> {
        let mut c = sighting.covariance;
        for i in 0..NUMBERS {
            for j in 0..NUMBERS {
                c[(i, j)] *= self.scales[GROUP[i]] * self.scales[GROUP[j]];
                if (i < GEOMETRY) != (j < GEOMETRY) {
                    c[(i, j)] = 0.0;
                }
            }
        }
        c
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
        let taken: Vec<&Sighting> =
            self.sightings.iter().enumerate().filter(|(i, _)| take(*i)).map(|(_, s)| s).collect();
        let inverse: Vec<_> = taken.iter().map(|s| self.covariance(s).try_inverse()).collect::<Option<Vec<_>>>()?;
        let fits = starts.iter().filter_map(|start| self.descend(*start, &prior, &taken, &inverse));
        fits.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    fn descend(
        &self,
        start: [f64; SHARED],
        prior: &[f64; SHARED],
        taken: &[&Sighting],
        inverse: &[SMatrix<f64, NUMBERS, NUMBERS>],
    ) -> Option<Fit> {
        let mut shared = start;
        let mut energy = self.energy(&shared, prior, taken, inverse);
        let mut damping = 1e-4;
        let (mut h, mut g) = self.slopes(&shared, prior, taken, inverse);
        for _ in 0..40 {
            let mut a = h.clone();
            (0..SHARED).for_each(|i| a[(i, i)] *= 1.0 + damping);
            let step = a.cholesky()?.solve(&g);
            let next: [f64; SHARED] = std::array::from_fn(|i| shared[i] + step[i]);
            let then = self.energy(&next, prior, taken, inverse);
            if then < energy {
                let gained = energy - then;
                (shared, energy, damping) = (next, then, (0.1 * damping).max(1e-9));
                (h, g) = self.slopes(&shared, prior, taken, inverse);
                if gained < 1e-7 {
                    break;
                }
            } else {
                damping = (10.0 * damping).max(1e-3);
                if damping > 1e6 {
                    break;
                }
            }
        }
        let factor = h.clone().cholesky()?;
        let volume: f64 = factor.l().diagonal().iter().map(|x| x.ln()).sum();
        let covariance = factor.inverse();
        let evidence = -energy - volume - prior.iter().map(|p| p.ln()).sum::<f64>();
        let squares = |(s, inv): (&&Sighting, &SMatrix<f64, NUMBERS, NUMBERS>)| {
            let of = blocks(&self.residual(&shared, s), inv);
            (0..2).map(|k| of[k] * (TAILS + COUNT[k]) / (TAILS + of[k])).sum::<f64>()
        };
        // As of a Gaussian with the tolerances in its covariance: what tolerated deviations have to do for the fit counts, too.
        let of_prior: f64 = shared.iter().zip(prior).map(|(x, p)| (x / p).powi(2)).sum();
        let level =
            (of_prior + taken.iter().zip(inverse).map(squares).sum::<f64>()) / (NUMBERS * taken.len().max(1)) as f64;
        let deviations = std::array::from_fn(|i| covariance[(i, i)].max(0.0).sqrt());
        evidence.is_finite().then_some(Fit { shared, deviations, evidence, level })
    }

    /// Minus the log of likelihood times prior, but for constants.
    fn energy(
        &self,
        shared: &[f64; SHARED],
        prior: &[f64; SHARED],
        taken: &[&Sighting],
        inverse: &[SMatrix<f64, NUMBERS, NUMBERS>],
    ) -> f64 {
        let of_prior: f64 = shared.iter().zip(prior).map(|(x, p)| 0.5 * (x / p).powi(2)).sum();
        let of = |(s, inv): (&&Sighting, &SMatrix<f64, NUMBERS, NUMBERS>)| {
            let squares = blocks(&self.residual(shared, s), inv);
            let part = |k: usize| 0.5 * (TAILS + COUNT[k]) * (1.0 + squares[k] / TAILS).ln();
            part(0) + part(1)
        };
        of_prior + taken.iter().zip(inverse).map(of).sum::<f64>()
    }

    /// Curvature (reweighted squares) and downhill slope of the energy.
    fn slopes(
        &self,
        shared: &[f64; SHARED],
        prior: &[f64; SHARED],
        taken: &[&Sighting],
        inverse: &[SMatrix<f64, NUMBERS, NUMBERS>],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut h = DMatrix::zeros(SHARED, SHARED);
        let mut g = DVector::zeros(SHARED);
        for i in 0..SHARED {
            h[(i, i)] = 1.0 / (prior[i] * prior[i]);
            g[i] = -shared[i] / (prior[i] * prior[i]);
        }
        for (s, inv) in taken.iter().zip(inverse) {
            let r = self.residual(shared, s);
            let squares = blocks(&r, inv);
            let mut j = SMatrix::<f64, NUMBERS, SHARED>::zeros();
            for i in 0..SHARED {
                let step = if i == DELAY { 0.004 } else { 1e-4 };
                let (mut plus, mut minus) = (*shared, *shared);
                plus[i] += step;
                minus[i] -= step;
                j.set_column(i, &((self.residual(&plus, s) - self.residual(&minus, s)) / (2.0 * step)));
            }
            let mut weighted = *inv;
            for a in 0..NUMBERS {
                let k = usize::from(a >= GEOMETRY);
                let weight = (TAILS + COUNT[k]) / (TAILS + squares[k]);
                weighted.row_mut(a).scale_mut(weight);
            }
            let across = j.transpose() * weighted;
            let (part, slope) = (across * j, across * r);
            for a in 0..SHARED {
                g[a] -= slope[a];
                (0..SHARED).for_each(|b| h[(a, b)] += part[(a, b)]);
            }
        }
        (h, g)
    }
}

/// Numbers in geometry and in brightness.
const COUNT: [f64; 2] = [GEOMETRY as f64, (NUMBERS - GEOMETRY) as f64];

/// Squares of geometry and of brightness.
fn blocks(r: &Numbers, inverse: &SMatrix<f64, NUMBERS, NUMBERS>) -> [f64; 2] {
    let all = inverse * r;
    let part = |range: std::ops::Range<usize>| range.map(|i| r[i] * all[i]).sum();
    [part(0..GEOMETRY), part(GEOMETRY..NUMBERS)]
}
