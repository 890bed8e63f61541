//! What training is asked for. The numbers of `Default` are those of the papers' programs: Kerbl et al., *3D Gaussian Splatting* (2023),
//! Kheradmand et al., *3D Gaussian Splatting as Markov Chain Monte Carlo* (2024), with the constants of gsplat 1.5.3.

use crate::SplatError;
use crate::error::off;

/// Weights of the terms of the loss; 0 leaves one out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Share of 1 - SSIM in the photometric loss; the rest is L1.
    pub ssim: f32,
    /// Mean opacity (Kheradmand et al., 2024).
    pub opacity: f32,
    /// Mean scale in units of the extent.
    pub scale: f32,
    /// Squared distance of exposures from identity.
    pub exposure: f32,
    /// Mean of the smallest scale in units of the extent (2D planar regularisation).
    pub flattening: f32,
    /// Mean distance of the rendered normal from that of the plane depth (PGSR, eq. 6, without its edge weight).
    pub depth_normal: f32,
    /// Mean relative error of the mean depth against measured depth.
    pub depth_prior: f32,
    /// Photometric consistency of patches of two views by homographies (PGSR, eq. 9 and 10).
    pub multi_view: f32,
    /// Cross-entropy of rendered features against label images.
    pub labels: f32,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            ssim: 0.2,
            opacity: 0.01,
            scale: 0.01,
            exposure: 0.01,
            flattening: 0.0,
            depth_normal: 0.0,
            depth_prior: 0.0,
            multi_view: 0.0,
            labels: 0.0,
        }
    }
}

impl Weights {
    /// Whether there is a term that counts from [`TrainOptions::geometry_from`] on only.
    pub fn geometry(&self) -> bool {
        self.planes() || self.flattening > 0.0 || self.depth_prior > 0.0 || self.labels > 0.0
    }

    /// Whether a term needs normals and plane depth.
    pub fn planes(&self) -> bool {
        self.depth_normal > 0.0 || self.multi_view > 0.0
    }
}

/// Parts of a run after which what moves is looked for, and the first of them: before, little is drawn that it could differ from.
const LOOKS: u32 = 10;
const FIRST_LOOK: u32 = 3;
/// Largest [`TrainOptions::drop`].
const MOST_DROPPED: f32 = 0.9;

/// How to train.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainOptions {
    /// Steps, one photograph each.
    pub iterations: u32,
    /// Most Gaussians.
    pub cap: usize,
    /// Learn an affine colour transform for each photograph.
    pub exposure: bool,
    /// Refine the poses of the photographs, and the place of each camera on what its poses were measured of.
    pub poses: bool,
    /// Degree of the harmonics at the end.
    pub sh_degree: u8,
    /// Steps after which the degree of the harmonics goes up by one.
    pub sh_interval: u32,
    /// First step at which Gaussians come and go.
    pub refine_from: u32,
    /// Steps from one such to the next.
    pub refine_every: u32,
    /// Step from which on terms of the geometry count.
    pub geometry_from: u32,
    /// Terms of the loss.
    pub weights: Weights,
    /// Noise of the means in units of their rate, all in units of the extent.
    pub noise: f32,
    /// Share of the Gaussians that a step leaves out, at the end of the run; it rises from 0. Helps with few photographs.
    pub drop: f32,
    /// Leave out of photographs what moves ([`super::transients`]).
    pub transients: bool,
    /// The same seed gives the same bits on the CPU.
    pub seed: u32,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            iterations: 7000,
            cap: 300_000,
            exposure: false,
            poses: false,
            sh_degree: 3,
            sh_interval: 1000,
            refine_from: 500,
            refine_every: 100,
            geometry_from: 1000,
            weights: Weights::default(),
            noise: 5e5,
            drop: 0.0,
            transients: false,
            seed: 0,
        }
    }
}

/// Rates of one step, by group of parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Metres.
    pub means: f32,
    /// Natural logarithm.
    pub log_scales: f32,
    /// Of quaternions.
    pub rotations: f32,
    /// Of logits.
    pub opacities: f32,
    /// Of the constant harmonic.
    pub colours: f32,
    /// Of the other harmonics.
    pub harmonics: f32,
    /// Of features.
    pub features: f32,
    /// Of the entries of an exposure.
    pub exposures: f32,
    /// Of twists: metres are in units of the extent.
    pub poses: f32,
}

impl TrainOptions {
    /// Rates of a step. The means' rate goes with the extent of the cameras \[m\] and falls to a hundredth by the end.
    pub fn rates(&self, iteration: u32, extent: f32) -> Rates {
        let fall = 0.01f32.powf(iteration as f32 / self.iterations.max(1) as f32);
        Rates {
            means: 1.6e-4 * extent * fall,
            log_scales: 5e-3,
            rotations: 1e-3,
            opacities: 5e-2,
            colours: 2.5e-3,
            harmonics: 2.5e-3 / 20.0,
            features: 2.5e-3,
            exposures: 5e-3 * fall.sqrt(),
            poses: 3e-4 * fall,
        }
    }

    /// What scales the noise of the means in a step \[1/m\].
    pub(crate) fn noise_rate(&self, iteration: u32, extent: f32) -> f32 {
        self.noise * self.rates(iteration, extent).means / (extent * extent)
    }

    /// Degree of the harmonics in a step.
    pub fn degree(&self, iteration: u32) -> u8 {
        let raised = iteration / self.sh_interval.max(1);
        raised.min(self.sh_degree as u32) as u8
    }

    /// Whether Gaussians come and go after a step. The last sixth of a run is left to settle, as 25 000 of 30 000 steps do.
    pub fn refines(&self, iteration: u32) -> bool {
        iteration > self.refine_from
            && iteration.is_multiple_of(self.refine_every.max(1))
            && iteration <= self.last_refinement()
    }

    /// Whether what moves is looked for after a step: from three tenths of the run on, each tenth.
    pub fn looks_for_transients(&self, iteration: u32) -> bool {
        let every = (self.iterations / LOOKS).max(1);
        self.transients
            && iteration >= FIRST_LOOK * every
            && iteration < self.iterations
            && iteration.is_multiple_of(every)
    }

    /// After which step Gaussians come and go no more.
    fn last_refinement(&self) -> u32 {
        let until = self.iterations - self.iterations / 6;
        until.min(25_000)
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// Names the first value that is off.
    pub fn check(&self) -> Result<(), SplatError> {
        let place = |name: &str| format!("training, {name}");
        if self.sh_degree > 3 {
            return Err(off(place("degree of harmonics"), "0 to 3", self.sh_degree));
        }
        if self.cap == 0 {
            return Err(off(place("cap"), "at least one Gaussian", 0));
        }
        let w = &self.weights;
        if !(0.0..=1.0).contains(&w.ssim) {
            return Err(off(place("share of SSIM"), "0 to 1", w.ssim));
        }
        if !(0.0..=MOST_DROPPED).contains(&self.drop) {
            return Err(off(place("share left out"), format!("0 to {MOST_DROPPED}"), self.drop));
        }
        for (name, weight) in [
            ("opacity", w.opacity),
            ("scale", w.scale),
            ("exposure", w.exposure),
            ("flattening", w.flattening),
            ("depth-normal", w.depth_normal),
            ("depth prior", w.depth_prior),
            ("multi-view", w.multi_view),
            ("labels", w.labels),
            ("noise", self.noise),
        ] {
            if !(weight.is_finite() && weight >= 0.0) {
                return Err(off(place(&format!("weight {name}")), "a number of at least 0", weight));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn rates_fall_and_degrees_rise() {
        let options = TrainOptions::default();
        let (first, last) = (options.rates(0, 2.0), options.rates(7000, 2.0));
        assert!((first.means - 3.2e-4).abs() < 1e-9 && (last.means - 3.2e-6).abs() < 1e-9);
        assert_eq!([0, 999, 1000, 2500, 6999].map(|i| options.degree(i)), [0, 0, 1, 2, 3]);
        assert_eq!([500, 600, 650, 5800, 5900].map(|i| options.refines(i)), [false, true, false, true, false]);
    }

    #[test]
    fn what_is_off_is_named() {
        let mut options = TrainOptions::default();
        assert_eq!(options.check(), Ok(()));
        options.weights.labels = f32::NAN;
        let error = options.check().unwrap_err().to_string();
        assert!(error.states("0 NaN"), "{error}");
        options.cap = 0;
        assert!(options.check().unwrap_err().to_string().contains("cap"));
    }
}
