//! Which effect of the camera all photographs share, measured as far as the policy asks for it.

use crate::CameraError;
use crate::align::{self, NUMBERS, Offsets};
use crate::footage::{Footage, Rig};
use crate::model::{BLUR, DELAY, FOCAL, Fit, GAIN, MOUNTING, PLACE, SHARED, Sighting, TOLERANCE, Together};
use crate::path::{Path, pose_of};
use crate::see::{LinearisedWindow, LookOptions, plus, stated};
use crate::sight::{Look, Looks};
use qv_core::random::SplitMix64;
use qv_core::statistics::median;
use qv_gap::decision::Policy;
use qv_gap::decision::evidence::CameraEvidence;
use qv_gap::report::{Cause, Noise, ParameterEstimate, VisualGap};
use rayon::prelude::*;
use std::ops::Range;

/// An effect of the camera.
#[derive(Debug)]
pub struct CameraEffect {
    /// Name in reports.
    pub name: &'static str,
    /// What it is, in a few words.
    pub about: &'static str,
    /// Unit of its values.
    pub unit: &'static str,
    /// Shared numbers that it moves.
    of: Range<usize>,
    /// Values that are believed.
    pub range: [f64; 2],
    /// What would distinguish it from the effects that look like it.
    experiment: &'static str,
}

/// The effects of a camera that may be accused.
pub const EFFECTS: [CameraEffect; 5] = [
    CameraEffect {
        name: "camera_exposure",
        about: "images are brighter or darker than the scene: logarithm of the gain",
        unit: "1",
        of: GAIN..GAIN + 1,
        range: [-2.0, 2.0],
        experiment: "record images of a grey card with the exposure fixed",
    },
    CameraEffect {
        name: "camera_delay",
        about: "images are stamped early or late",
        unit: "s",
        of: DELAY..DELAY + 1,
        range: [-0.2, 0.3],
        experiment: "turn on the spot back and forth at two speeds: a delay moves the picture by the speed, a mounting does not",
    },
    CameraEffect {
        name: "camera_extrinsics",
        about: "the camera sits elsewhere on the robot, or looks elsewhere",
        unit: "m, rad",
        of: MOUNTING..MOUNTING + 6,
        range: [-0.5, 0.5],
        experiment: "stand still at several headings: a mounting is off in camera axes, the scene's place in those of the world",
    },
    CameraEffect {
        name: "camera_focal",
        about: "the focal length is off: logarithm of its scale",
        unit: "1",
        of: FOCAL..FOCAL + 1,
        range: [-0.4, 0.4],
        experiment: "record images of a board of known size at two distances",
    },
    CameraEffect {
        name: "camera_blur",
        about: "images are blurred, by motion or focus: variance of the blur",
        unit: "px²",
        of: BLUR..BLUR + 1,
        range: [0.0, 25.0],
        experiment: "stand still and record an edge: a lens out of focus blurs it, motion does not",
    },
];

/// Parts into which photographs are dealt: each is judged by a fit to the others.
const FOLDS: usize = 4;
/// Photographs that are shown.
const SHOWN: usize = 3;

struct Judge<'a> {
    footage: &'a Footage<'a>,
    together: Together<'a>,
    seen: &'a [LinearisedWindow],
    stated: Offsets,
    width: usize,
    policy: &'a Policy,
}

/// Judges what the photographs are off by.
pub fn judge(
    footage: &Footage,
    path: &Path,
    seen: &[LinearisedWindow],
    options: &LookOptions,
) -> Result<Look, CameraError> {
    let (rig, policy) = (footage.rig, &options.policy);
    let sightings: Vec<Sighting> = seen.iter().map(|s| s.sighting.clone()).collect();
    let no_good = || CameraError::new("images", "images that agree with the scene somewhere", "none");
    let together = Together::new(path, rig.base_from_camera, rig.delay, &sightings).ok_or_else(no_good)?;
    let judge = Judge { footage, together, seen, stated: stated(&rig, options.width), width: options.width, policy };
    let shows_another_place = judge.share_accounted_for() < policy.camera.accounted;
    let free: Vec<usize> = (0..PLACE).collect();
    let all = judge.together.fit(&free, &[[0.0; SHARED]], |_| true).ok_or_else(no_good)?;
    let none = judge.fit(&[], &all, |_| true).ok_or_else(no_good)?;

    let allowed: Vec<usize> = (0..EFFECTS.len())
        .filter(|_| !shows_another_place)
        .filter(|&e| !options.without.iter().any(|w| w == EFFECTS[e].name))
        .collect();
    let mut accused: Vec<usize> = Vec::new();
    let mut best = none.clone();
    let mut first: Vec<(usize, f64)> = Vec::new();
    let mut confusable: Vec<Vec<usize>> = Vec::new();
    let mut before: Vec<f64> = seen.iter().map(|s| s.before.loss).collect();
    let measured = before.clone();
    while accused.len() < policy.camera.most {
        let mut ranked: Vec<(usize, f64, Fit)> = allowed
            .iter()
            .filter(|e| !accused.contains(e))
            .filter_map(|&e| {
                let with = [&accused[..], &[e]].concat();
                let fit = judge.fit(&with, &all, |_| true)?;
                Some((e, fit.evidence - best.evidence, fit))
            })
            .collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        if first.is_empty() {
            first = ranked.iter().map(|(e, evidence, _)| (*e, *evidence)).collect();
        }
        let Some((effect, evidence, fit)) = ranked.first() else { break };
        if *evidence < policy.camera.evidence || !judge.is_large(*effect, &fit.shared) {
            break;
        }
        let with = [&accused[..], &[*effect]].concat();
        let after = judge.unseen(&with, &all)?;
        let floor: f64 = seen.iter().map(|s| s.aligned.disagreement.loss).sum();
        let (fall, error) = fall(&before, &after);
        let closes = fall * seen.len() as f64 > policy.camera.closed * (before.iter().sum::<f64>() - floor);
        if fall < policy.camera.errors * error || !closes {
            break;
        }
        let alike = ranked[1..].iter().filter(|r| r.1 > evidence - policy.camera.alike && r.1 > policy.camera.evidence);
        confusable.push(alike.map(|r| r.0).collect());
        accused.push(*effect);
        (best, before) = (fit.clone(), after);
    }
    let left = match (shows_another_place, judge.place_of_scene(&accused, &best)) {
        (true, _) => Some(
            "What is wrong with the camera: the scene accounts for hardly anything in the images; it may be of another place, or in another frame."
                .to_string(),
        ),
        (false, Some([shift, turn])) => Some(format!(
            "Why the scene lies {shift:.2} m and {:.1} degrees off the frame of the poses: that is no effect of the camera; align the scene with the poses.",
            turn.to_degrees()
        )),
        (false, None) => None,
    };
    judge.look(
        &EffectSearch { accused, confusable, first, none, best, all, before: measured, after: before, left },
        options,
    )
}

/// What the search for effects came to.
struct EffectSearch {
    accused: Vec<usize>,
    /// What looks like each of them.
    confusable: Vec<Vec<usize>>,
    /// Log evidence of each effect alone.
    first: Vec<(usize, f64)>,
    /// Fits without an effect, with the accused ones, with all that a camera can be off by.
    none: Fit,
    best: Fit,
    all: Fit,
    /// Disagreement of each photograph without the accused, and with.
    before: Vec<f64>,
    after: Vec<f64>,
    /// What no effect of a camera explains.
    left: Option<String>,
}

impl Judge<'_> {
    /// A fit with these effects wide, from nothing and from where everything is free.
    fn fit(&self, effects: &[usize], all: &Fit, take: impl Fn(usize) -> bool) -> Option<Fit> {
        let wide: Vec<usize> = effects.iter().flat_map(|&e| EFFECTS[e].of.clone()).collect();
        let mut start = [0.0; SHARED];
        wide.iter().for_each(|&i| start[i] = all.shared[i]);
        self.together.fit(&wide, &[[0.0; SHARED], start], take)
    }

    /// Median over photographs of the share of their contrast that the scene accounts for where it agrees best.
    fn share_accounted_for(&self) -> f64 {
        let share = |d: &align::Disagreement| if d.blank > 0.0 { 1.0 - d.loss / d.blank } else { 0.0 };
        let mut shares: Vec<f64> = self.seen.iter().map(|s| share(&s.aligned.disagreement)).collect();
        median(&mut shares)
    }

    /// How far the scene lies off the poses' frame \[m, rad\], where there is evidence of that beside what is accused.
    fn place_of_scene(&self, accused: &[usize], best: &Fit) -> Option<[f64; 2]> {
        let mut wide: Vec<usize> = accused.iter().flat_map(|&e| EFFECTS[e].of.clone()).collect();
        wide.extend(PLACE..SHARED);
        let fit = self.together.fit(&wide, &[[0.0; SHARED], best.shared], |_| true)?;
        let size = (PLACE..SHARED).map(|i| (fit.shared[i] / TOLERANCE[i]).powi(2)).sum::<f64>().sqrt();
        let norm = |of: Range<usize>| of.map(|i| fit.shared[i].powi(2)).sum::<f64>().sqrt();
        let is_off = fit.evidence - best.evidence > self.policy.camera.evidence && size >= self.policy.camera.size;
        is_off.then(|| [norm(PLACE..PLACE + 3), norm(PLACE + 3..SHARED)])
    }

    /// Beyond tolerance, and within the range that is believed.
    fn is_large(&self, effect: usize, shared: &[f64; SHARED]) -> bool {
        let CameraEffect { of, range, .. } = &EFFECTS[effect];
        let size = of.clone().map(|i| (shared[i] / TOLERANCE[i]).powi(2)).sum::<f64>().sqrt();
        size >= self.policy.camera.size && of.clone().all(|i| (range[0]..=range[1]).contains(&shared[i]))
    }

    /// Offsets that effects alone foretell.
    fn predicted(&self, effects: &[usize], shared: &[f64; SHARED], time: f64) -> Offsets {
        let mut only = [0.0; SHARED];
        effects.iter().flat_map(|&e| EFFECTS[e].of.clone()).for_each(|i| only[i] = shared[i]);
        plus(&self.together.predicted(&only, time), &self.stated)
    }

    /// Disagreement of each photograph with these effects as the other photographs have them.
    fn unseen(&self, effects: &[usize], all: &Fit) -> Result<Vec<f64>, CameraError> {
        let fits: Vec<Option<Fit>> = (0..FOLDS).map(|fold| self.fit(effects, all, |i| i % FOLDS != fold)).collect();
        let one = |(i, seen): (usize, &LinearisedWindow)| {
            let Some(fit) = &fits[i % FOLDS] else { return Ok(seen.before.loss) };
            let offsets = self.predicted(effects, &fit.shared, seen.sighting.time);
            Ok(align::disagreement(self.footage.cloud, &seen.target, &offsets, seen.target.levels() - 1)?.loss)
        };
        self.seen.par_iter().enumerate().map(one).collect()
    }

    fn look(&self, found: &EffectSearch, options: &LookOptions) -> Result<Look, CameraError> {
        let EffectSearch { accused, confusable, first, none, best, all, before, after, left } = found;
        let floor: Vec<f64> = self.seen.iter().map(|s| s.aligned.disagreement.loss).collect();
        let mut causes = Vec::new();
        for (k, &effect) in accused.iter().enumerate() {
            let alone = if accused.len() == 1 { after.to_vec() } else { self.unseen(&[effect], all)? };
            let names = |of: &[usize]| of.iter().map(|&e| EFFECTS[e].name.to_string()).collect::<Vec<_>>();
            let mut confusable_with = names(&confusable[k]);
            // Only photographs against poses: which of the two clocks is off cannot be seen here.
            if EFFECTS[effect].name == "camera_delay" {
                confusable_with.push("pose_delay".into());
            }
            causes.push(Cause {
                effect: EFFECTS[effect].name.into(),
                score: 0.0,
                scope: vec!["all".into()],
                parameters: self.estimates(effect, best),
                closed_alone: closed(before, &alone, &floor),
                confusable_with,
                separating_experiment: EFFECTS[effect].experiment.into(),
                by_recording: Vec::new(),
            });
        }
        let evidence = CameraEvidence {
            photographs: self.seen.len(),
            size: [self.footage.rig.intrinsics.width as usize, self.footage.rig.intrinsics.height as usize],
            gap: self.gap(before, after, &floor, options.seed),
            level: [none.level, best.level],
            causes,
            evidence: first.iter().map(|(e, evidence)| (EFFECTS[*e].name.to_string(), *evidence)).collect(),
            shared: (0..EFFECTS.len()).flat_map(|e| self.estimates(e, all)).collect(),
            noise: self.noise(),
            is_scene_off: left.is_some(),
            cannot_tell: left.iter().cloned().chain(self.cannot_tell(all)).collect(),
        };
        Ok(Look { evidence, corrected: self.corrected(accused, best), pictures: self.pictures(accused, best)? })
    }

    fn gap(&self, before: &[f64], after: &[f64], floor: &[f64], seed: u64) -> VisualGap {
        let root = |x: &[f64]| (x.iter().sum::<f64>() / x.len() as f64).sqrt();
        let mut random = SplitMix64::of(seed, 71);
        let n = before.len();
        let mut draws: Vec<f64> = (0..400)
            .map(|_| {
                let of: Vec<usize> = (0..n).map(|_| ((random.uniform() * n as f64) as usize).min(n - 1)).collect();
                let take = |x: &[f64]| of.iter().map(|&i| x[i]).collect::<Vec<f64>>();
                closed(&take(before), &take(after), &take(floor))
            })
            .collect();
        draws.sort_by(f64::total_cmp);
        VisualGap {
            before: root(before),
            after: root(after),
            floor: root(floor),
            closed: closed(before, after, floor),
            closed_ci95: [draws[10], draws[389]],
            unit: "root mean square of displayed brightness, 0 to 1".into(),
            heldout: true,
        }
    }

    /// Pixels of the photograph for one of the picture that is compared.
    fn magnification(&self) -> f64 {
        let width = f64::from(self.footage.rig.intrinsics.width);
        width / (self.width as f64).min(width)
    }

    /// Values of an effect in units that people use.
    fn estimates(&self, effect: usize, fit: &Fit) -> Vec<ParameterEstimate> {
        let of = &EFFECTS[effect].of;
        let half = |i: usize| 1.96 * fit.deviations[i].hypot(0.7 * TOLERANCE[i]).hypot(0.03 * fit.shared[i]);
        let plain = |i: usize, name: &str, unit: &str, factor: f64| {
            let (value, half) = (factor * fit.shared[i], factor * half(i));
            ParameterEstimate { name: name.into(), value, ci95: [value - half, value + half], unit: unit.into() }
        };
        match EFFECTS[effect].name {
            "camera_exposure" => {
                let (x, h) = (fit.shared[GAIN], half(GAIN));
                let gain = ParameterEstimate {
                    name: "gain".into(),
                    value: x.exp(),
                    ci95: [(x - h).exp(), (x + h).exp()],
                    unit: "1".into(),
                };
                // Displayed values are light to the power 1 / 2.2.
                vec![gain, plain(GAIN, "stops", "EV", 2.2 / std::f64::consts::LN_2)]
            }
            "camera_delay" => vec![plain(DELAY, "delay", "s", 1.0)],
            "camera_extrinsics" => {
                let axes = ["x", "y", "z"];
                let rotation = (0..3).map(|k| plain(of.start + 3 + k, &format!("rotation_{}", axes[k]), "rad", 1.0));
                let translation = (0..3).map(|k| plain(of.start + k, &format!("translation_{}", axes[k]), "m", 1.0));
                rotation.chain(translation).collect()
            }
            "camera_focal" => {
                let (x, h) = (fit.shared[FOCAL], half(FOCAL));
                vec![ParameterEstimate {
                    name: "focal_scale".into(),
                    value: x.exp(),
                    ci95: [(x - h).exp(), (x + h).exp()],
                    unit: "1".into(),
                }]
            }
            _ => {
                let deviation = |variance: f64| variance.max(0.0).sqrt() * self.magnification();
                let (x, h) = (fit.shared[BLUR], half(BLUR));
                vec![ParameterEstimate {
                    name: "blur".into(),
                    value: deviation(x),
                    ci95: [deviation(x - h), deviation(x + h)],
                    unit: "px".into(),
                }]
            }
        }
    }

    /// The camera with these effects.
    fn corrected(&self, effects: &[usize], fit: &Fit) -> Rig {
        let mut only = [0.0; SHARED];
        effects.iter().flat_map(|&e| EFFECTS[e].of.clone()).for_each(|i| only[i] = fit.shared[i]);
        let mut rig = self.footage.rig;
        rig.base_from_camera = rig.base_from_camera * pose_of(&only[..6]).inverse();
        rig.delay += only[DELAY];
        rig.gain *= only[GAIN].exp();
        rig.intrinsics.fx *= only[FOCAL].exp();
        rig.intrinsics.fy *= only[FOCAL].exp();
        let variance = (rig.blur / self.magnification()).powi(2) + only[BLUR];
        rig.blur = variance.max(0.0).sqrt() * self.magnification();
        rig
    }

    /// Scatter of the photographs, in the units of their numbers.
    fn noise(&self) -> Noise {
        let typical = |of: Range<usize>, group: usize| {
            let mut sizes: Vec<f64> = self
                .seen
                .iter()
                .map(|s| (of.clone().map(|i| s.sighting.covariance[(i, i)]).sum::<f64>() / of.len() as f64).sqrt())
                .collect();
            self.together.scales[group] * median(&mut sizes)
        };
        Noise {
            rotation: typical(3..6, 0),
            translation: typical(0..3, 0),
            gain: typical(8..9, 3),
            focal: typical(6..7, 1),
        }
    }

    fn cannot_tell(&self, all: &Fit) -> Vec<String> {
        let mut out = Vec::new();
        if all.deviations[DELAY] > 0.01 {
            out.push(format!(
                "Whether the camera is late: the robot hardly moved, so that its delay is known to {:.0} ms only.",
                1e3 * all.deviations[DELAY]
            ));
        }
        let turn = (MOUNTING + 3..MOUNTING + 6).map(|i| all.deviations[i]).fold(0.0, f64::max);
        if turn > 0.0053 {
            out.push(format!("How the camera is turned on the robot, nearer than {:.1} degrees.", turn.to_degrees()));
        }
        if all.shared[BLUR] < -0.5 {
            out.push("Whether the camera is out of focus: the scene is more blurred than the images.".into());
        }
        if self.seen.len() < 2 * NUMBERS {
            out.push(format!("Small effects of the camera: only {} images show the scene.", self.seen.len()));
        }
        out
    }

    /// Photographs beside the scene, spread over those with a typical gap.
    fn pictures(&self, effects: &[usize], best: &Fit) -> Result<Vec<Looks>, CameraError> {
        let count = self.seen.len().min(SHOWN);
        let shown = (0..count).map(|k| &self.seen[(2 * k + 1) * self.seen.len() / (2 * count)]);
        let one = |seen: &LinearisedWindow| {
            let fine = seen.target.pictures.last().expect("a level");
            let size = (fine.width, fine.height);
            let measured = self.drawn(seen, &self.stated, size)?;
            let after = self.drawn(seen, &self.predicted(effects, &best.shared, seen.sighting.time), size)?;
            let grey = |x: f32| [(255.0 * x.clamp(0.0, 1.0)) as u8; 3];
            let difference = |shown: &[f32]| -> Vec<u8> {
                let pairs = fine.values.iter().zip(shown.chunks_exact(3));
                pairs
                    .flat_map(|(p, c)| {
                        let d = p - crate::picture::brightness([c[0], c[1], c[2]]);
                        grey(if d.is_finite() { 0.5 + d } else { 0.5 })
                    })
                    .collect()
            };
            let bytes = |shown: &[f32]| shown.iter().map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8).collect();
            Ok(Looks {
                time: seen.sighting.time,
                width: size.0,
                height: size.1,
                photograph: fine.values.iter().flat_map(|v| grey(if v.is_finite() { *v } else { 0.0 })).collect(),
                difference_before: difference(&measured),
                difference_after: difference(&after),
                measured: bytes(&measured),
                corrected: bytes(&after),
            })
        };
        shown.map(one).collect()
    }

    /// What the scene shows with offsets, shape `[height, width, 3]`.
    fn drawn(&self, seen: &LinearisedWindow, offsets: &Offsets, size: (usize, usize)) -> Result<Vec<f32>, CameraError> {
        let drawn = align::draw(self.footage.cloud, &seen.target, offsets, size)?;
        let channel = |c: usize| {
            let values = drawn.colour.iter().skip(c).step_by(3).copied().collect();
            crate::picture::Picture { width: size.0, height: size.1, values }.blurred(offsets.blur).values
        };
        let channels = [channel(0), channel(1), channel(2)];
        let gain = offsets.gain.exp() as f32;
        Ok((0..size.0 * size.1).flat_map(|i| [0, 1, 2].map(|c| gain * channels[c][i] + offsets.bias as f32)).collect())
    }
}

/// Mean fall of the loss over photographs, and its standard error.
fn fall(before: &[f64], after: &[f64]) -> (f64, f64) {
    let n = before.len() as f64;
    let falls: Vec<f64> = before.iter().zip(after).map(|(b, a)| b - a).collect();
    let mean = falls.iter().sum::<f64>() / n;
    let variance = falls.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, (variance / n).sqrt())
}

/// Share of the squares above the floor that were taken away.
fn closed(before: &[f64], after: &[f64], floor: &[f64]) -> f64 {
    let sum = |x: &[f64]| x.iter().sum::<f64>();
    ((sum(before) - sum(after)) / (sum(before) - sum(floor)).max(1e-12)).clamp(0.0, 1.0)
}
