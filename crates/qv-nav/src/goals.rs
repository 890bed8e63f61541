//! Objects that can be goals: their shape and colour, and the numbers by which a network learns at run time which one is wanted.

use crate::NavError;
use crate::flat::add_flat;
use crate::sizes::COLOUR;
use glam::DVec3;
use qv_core::GaussianCloud;
use qv_core::random::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// What a goal is shaped like. All stand upright on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A cone with its tip up.
    Cone,
    /// A cylinder.
    Pillar,
    /// A box with a square foot.
    Crate,
    /// A ball.
    Ball,
}

/// One object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// Its shape.
    pub shape: Shape,
    /// Height \[m\].
    pub height: f64,
    /// Half of its width at the foot, of a ball its radius \[m\].
    pub half_width: f64,
    /// Colour as it is commanded: red, green, blue as shown in neutral light, 0 to 1.
    pub colour: [f32; 3],
    /// Colour as it is drawn, before light: a real object is not exactly of the colour that was asked for.
    pub drawn: [f32; 3],
}

/// Hues of goals that no training draws \[degrees\]: a goal of an unseen colour is one of these.
pub const UNSEEN_HUES: [f32; 2] = [265.0, 320.0];
/// Least chroma of a commanded colour, as a share of its greatest channel: below it, it has no hue.
pub const LEAST_CHROMA: f32 = 0.35;

/// Which goals a place has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GoalKind {
    /// Shapes and hues of trainings.
    Trained,
    /// Balls, of hues that no training draws ([`UNSEEN_HUES`]).
    Unseen,
}

impl Goal {
    /// One whose hue \[degrees\] is given.
    pub fn of_hue(kind: GoalKind, hue: f32, random: &mut Xoshiro256PlusPlus) -> Self {
        let mut draw = |low: f64, high: f64| f64::from(random.between(low as f32, high as f32));
        let shape = match kind {
            GoalKind::Unseen => Shape::Ball,
            GoalKind::Trained => [Shape::Cone, Shape::Cone, Shape::Pillar, Shape::Crate][(draw(0.0, 3.999)) as usize],
        };
        let (height, half_width) = match shape {
            Shape::Cone => (draw(0.38, 0.52), draw(0.085, 0.12)),
            Shape::Pillar => (draw(0.30, 0.50), draw(0.06, 0.11)),
            Shape::Crate => (draw(0.22, 0.40), draw(0.08, 0.12)),
            Shape::Ball => {
                let radius = draw(0.11, 0.15);
                (2.0 * radius, radius)
            }
        };
        let (saturation, value) = (draw(0.65, 1.0) as f32, draw(0.45, 1.0) as f32);
        let off = [draw(-8.0, 8.0) as f32, draw(0.85, 1.1) as f32];
        let colour = of_hsv(hue, saturation, value);
        let drawn = of_hsv(hue + off[0], (saturation * off[1]).min(1.0), value);
        Self { shape, height, half_width, colour, drawn }
    }

    /// `count` goals of one kind, their hues spread over all that the kind has.
    pub fn draw(kind: GoalKind, count: usize, random: &mut Xoshiro256PlusPlus) -> Vec<Self> {
        let [low, high] = UNSEEN_HUES;
        let (from, span) = match kind {
            // A margin, so that no drawn colour of a training lies in what is unseen.
            GoalKind::Trained => (high + 10.0, 360.0 - (high - low) - 20.0),
            GoalKind::Unseen => (low, high - low),
        };
        let share = |k: usize, random: &mut Xoshiro256PlusPlus| (k as f32 + random.unit()) / count as f32;
        (0..count)
            .map(|k| {
                let hue = from + span * share(k, random);
                Self::of_hue(kind, hue, random)
            })
            .collect()
    }

    /// Adds it to a cloud as flat Gaussians, standing at the origin, lit from one side; gives their number.
    pub fn add(&self, cloud: &mut GaussianCloud, brightness: f64) -> usize {
        let before = cloud.len();
        let linear = self.drawn.map(|c| brightness * f64::from(c).powf(2.2));
        for (point, normal, [across, along]) in self.surface() {
            let normal = normal.normalize();
            let side = if normal.z.abs() > 0.9 { DVec3::X } else { DVec3::Z };
            let scales = [across, along, 0.002].map(|s: f64| s.max(0.003).ln() as f32);
            add_flat(cloud, point, [normal.cross(side).normalize(), normal], scales, linear);
        }
        cloud.len() - before
    }

    /// Points, outward normals and half sizes of flat pieces of its surface.
    fn surface(&self) -> Vec<(DVec3, DVec3, [f64; 2])> {
        const STEP: f64 = 0.03;
        let (wide, tall) = (self.half_width, self.height);
        let rows = (tall / STEP).ceil().max(3.0) as usize;
        let mut out = Vec::new();
        for row in 0..rows {
            let up = (row as f64 + 0.4) / rows as f64;
            let (radius, z, lean) = match self.shape {
                Shape::Cone => (wide * (1.0 - up), up * tall, wide / tall),
                Shape::Pillar | Shape::Crate => (wide, up * tall, 0.0),
                Shape::Ball => {
                    let polar = 0.5 * TAU * up;
                    (wide * polar.sin(), wide * (1.0 - polar.cos()), -polar.cos() / polar.sin().max(0.05))
                }
            };
            let around = (TAU * radius / STEP).round().max(4.0) as usize;
            for k in 0..around {
                let angle = TAU * (k as f64 + 0.5) / around as f64;
                let (mut out_of, mut reach) = (DVec3::new(angle.cos(), angle.sin(), 0.0), radius);
                if self.shape == Shape::Crate {
                    // Onto the square about the circle.
                    reach = radius / out_of.x.abs().max(out_of.y.abs());
                    let is_x = out_of.x.abs() > out_of.y.abs();
                    let place = out_of * reach;
                    out_of = if is_x { DVec3::X * out_of.x.signum() } else { DVec3::Y * out_of.y.signum() };
                    out.push((place + DVec3::Z * z, out_of, [0.7 * STEP, 0.6 * tall / rows as f64]));
                    continue;
                }
                let half = [(0.55 * TAU * radius / around as f64).max(0.004), 0.6 * tall / rows as f64];
                out.push((out_of * reach + DVec3::Z * z, out_of + DVec3::Z * lean, half));
            }
        }
        if matches!(self.shape, Shape::Pillar | Shape::Crate) {
            let cells = (wide / STEP).ceil() as i32;
            for (i, j) in (-cells..=cells).flat_map(|i| (-cells..=cells).map(move |j| (i, j))) {
                let p = DVec3::new(f64::from(i), f64::from(j), 0.0) * (wide / f64::from(cells.max(1)));
                if self.shape == Shape::Crate || p.length() <= wide {
                    out.push((p + DVec3::Z * tall, DVec3::Z, [0.6 * STEP; 2]));
                }
            }
        }
        out
    }
}

/// Hues of the cones of [`crate::sight::COLOURS`] as they are seen \[degrees\].
const CONE_HUES: [f32; 3] = [2.0, 225.0, 47.0];

/// The goals of a place as episodes, eyes and networks count them: by index.
#[derive(Debug, Clone, PartialEq)]
pub struct GoalSet {
    /// Hues as commanded \[degrees\].
    hues: Vec<f32>,
    /// Whether a network is commanded by a name of [`crate::sight::COLOURS`] instead of by turned hues.
    is_named: bool,
    /// Their shapes and drawn colours; none for cones of three colours.
    goals: Vec<Goal>,
}

impl GoalSet {
    /// Cones of three colours ([`crate::sight::COLOURS`]), each commanded by its place in that list.
    pub fn named() -> Self {
        Self { hues: CONE_HUES.to_vec(), is_named: true, goals: Vec::new() }
    }

    /// The same cones, each commanded by its colour.
    pub fn coloured() -> Self {
        Self { is_named: false, ..Self::named() }
    }

    /// Other objects, each commanded by its colour.
    pub fn of(goals: Vec<Goal>) -> Self {
        Self { hues: goals.iter().map(|goal| hue(goal.colour)).collect(), is_named: false, goals }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.hues.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.hues.is_empty()
    }

    /// The numbers that command one beside the picture; of the last one beyond the end. Where hues are turned, all are red.
    pub fn code(&self, index: usize) -> [f32; COLOUR] {
        let at = if self.is_named { index.min(COLOUR - 1) } else { 0 };
        std::array::from_fn(|k| if k == at { 1.0 } else { 0.0 })
    }

    /// How far the hues of a picture are turned when one is wanted \[degrees\].
    pub fn turn(&self, index: usize) -> f32 {
        if self.is_named { 0.0 } else { SOUGHT - self.hues[index.min(self.hues.len() - 1)] }
    }

    /// The hue of one in the picture that a network sees \[degrees\].
    pub fn hue(&self, index: usize) -> f32 {
        self.hues[index.min(self.hues.len() - 1)] + self.turn(index)
    }

    /// The objects; none for cones of three colours.
    pub fn goals(&self) -> &[Goal] {
        &self.goals
    }

    /// Height of one \[m\], where it has one of its own.
    pub(crate) fn height(&self, index: usize) -> Option<f64> {
        self.goals.get(index).map(|goal| goal.height)
    }

    /// Whether two look so different that one cannot be taken for the other.
    pub(crate) fn are_apart(&self, a: usize, b: usize) -> bool {
        a != b && ((self.hues[a] - self.hues[b] + 180.0).rem_euclid(360.0) - 180.0).abs() > APART
    }
}

/// Hues of two goals that are asked for apart differ by more than this \[degrees\].
const APART: f32 = 28.0;

/// The hue that a network looks for \[degrees\]: that of the red cone. A goal of another hue is commanded by turning all hues of a picture so far
/// that the goal's becomes this one ([`turn_hues`]); so a network that finds red goals finds those of all hues.
pub const SOUGHT: f32 = 2.0;

/// How far hues are to be turned for a goal of a colour \[degrees\].
pub fn turn_of(colour: [f32; 3]) -> f32 {
    SOUGHT - hue(colour)
}

/// Turns the hues of a picture (bytes red, green, blue) by an angle \[degrees\]; saturation and value stay.
pub fn turn_hues(rgb: &mut [u8], degrees: f32) {
    // In sixths of the circle.
    let turn = (degrees / 60.0).rem_euclid(6.0);
    if turn == 0.0 {
        return;
    }
    for pixel in rgb.chunks_exact_mut(3) {
        let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(f32::from);
        let (most, least) = (r.max(g).max(b), r.min(g).min(b));
        let spread = most - least;
        if spread <= 0.0 {
            continue;
        }
        let sector = if most == r {
            (g - b) / spread
        } else if most == g {
            (b - r) / spread + 2.0
        } else {
            (r - g) / spread + 4.0
        };
        let sector = (sector + turn).rem_euclid(6.0);
        for (byte, offset) in pixel.iter_mut().zip([0.0f32, 4.0, 2.0]) {
            let off = (((sector + offset).rem_euclid(6.0) - 3.0).abs() - 1.0).clamp(0.0, 1.0);
            *byte = (least + spread * off + 0.5) as u8;
        }
    }
}

/// Chroma of a colour as a share of its greatest channel (the saturation of HSV).
pub fn chroma(colour: [f32; 3]) -> f32 {
    let most = colour.iter().copied().fold(0.0, f32::max);
    let least = colour.iter().copied().fold(f32::INFINITY, f32::min);
    if most > 0.0 { (most - least) / most } else { 0.0 }
}

/// A colour of hue \[degrees\], saturation and value.
pub fn of_hsv(hue: f32, saturation: f32, value: f32) -> [f32; 3] {
    let sector = hue.rem_euclid(360.0) / 60.0;
    [0.0, 4.0, 2.0].map(|turn: f32| {
        let off = ((sector + turn).rem_euclid(6.0) - 3.0).abs() - 1.0;
        value * (1.0 - saturation * (1.0 - off.clamp(0.0, 1.0)))
    })
}

/// Hue of a colour \[degrees\]; 0 for grey.
pub fn hue([r, g, b]: [f32; 3]) -> f32 {
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let spread = most - least;
    if spread <= 0.0 {
        0.0
    } else if most == r {
        (60.0 * (g - b) / spread).rem_euclid(360.0)
    } else if most == g {
        60.0 * (b - r) / spread + 120.0
    } else {
        60.0 * (r - g) / spread + 240.0
    }
}

/// Colours with names.
pub const NAMED: [(&str, [f32; 3]); 8] = [
    ("red", [0.86, 0.23, 0.20]),
    ("orange", [0.95, 0.50, 0.10]),
    ("yellow", [0.91, 0.77, 0.17]),
    ("green", [0.15, 0.65, 0.25]),
    ("cyan", [0.10, 0.75, 0.80]),
    ("blue", [0.20, 0.36, 0.80]),
    ("purple", [0.55, 0.20, 0.75]),
    ("pink", [0.95, 0.35, 0.65]),
];

/// The colour of a word: a name, or `#rrggbb`.
///
/// # Errors
/// When it is neither, or has no hue.
pub fn colour_of(word: &str) -> Result<[f32; 3], NavError> {
    let named = NAMED.iter().find(|(name, _)| *name == word).map(|(_, colour)| *colour);
    let hex = || {
        let digits = word.strip_prefix('#').filter(|d| d.len() == 6)?;
        let number = u32::from_str_radix(digits, 16).ok()?;
        Some([16, 8, 0].map(|shift| ((number >> shift) & 255) as f32 / 255.0))
    };
    let names = NAMED.map(|(name, _)| name).join(", ");
    let colour = named.or_else(hex).ok_or_else(|| NavError::value("goal", &format!("{names} or #rrggbb"), word))?;
    match chroma(colour) >= LEAST_CHROMA {
        true => Ok(colour),
        false => Err(NavError::value("goal", "a colour with a hue: grey is no goal", word)),
    }
}

/// The colour of what a picture shows (bytes red, green, blue): the mean over the pixels of its most frequent hue.
///
/// # Errors
/// When it has no pixels with a hue.
pub fn colour_of_picture(rgb: &[u8]) -> Result<[f32; 3], NavError> {
    let pixels = rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|c| f32::from(c) / 255.0));
    let vivid: Vec<[f32; 3]> = pixels.filter(|&p| chroma(p) >= LEAST_CHROMA && p.iter().any(|c| *c > 0.2)).collect();
    const BINS: usize = 24;
    let bin = |colour: &[f32; 3]| (hue(*colour) / 360.0 * BINS as f32) as usize % BINS;
    let mut counts = [0usize; BINS];
    vivid.iter().for_each(|p| counts[bin(p)] += 1);
    // Hues lie on a circle: three bins in a row, or a colour on an edge would count half.
    let around = |k: usize| [(k + BINS - 1) % BINS, k, (k + 1) % BINS];
    let sum = |k: usize| around(k).iter().map(|b| counts[*b]).sum::<usize>();
    let best = (0..BINS).max_by_key(|&k| sum(k)).unwrap_or(0);
    let chosen: Vec<&[f32; 3]> = vivid.iter().filter(|p| around(best).contains(&bin(p))).collect();
    if chosen.is_empty() {
        return Err(NavError::value("picture of the goal", "pixels with a hue", "none"));
    }
    Ok(std::array::from_fn(|c| chosen.iter().map(|p| p[c]).sum::<f32>() / chosen.len() as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hues_come_back_and_brightness_does_not_matter() {
        for degrees in [0.0, 47.0, 130.0, 225.0, 300.0] {
            let colour = of_hsv(degrees, 0.8, 0.6);
            assert!((hue(colour) - degrees).abs() < 0.1 && (chroma(colour) - 0.8).abs() < 1e-5, "{degrees} {colour:?}");
            // The goal's hue becomes the one that is sought; grey stays grey.
            let mut picture = colour.map(|c| (255.0 * c).round() as u8).to_vec();
            picture.extend([77; 3]);
            turn_hues(&mut picture, turn_of(colour));
            let turned = [0, 1, 2].map(|k| f32::from(picture[k]) / 255.0);
            assert!((hue(turned) - SOUGHT + 180.0).rem_euclid(360.0) - 180.0 < 1.0, "{degrees} {turned:?}");
            assert!((chroma(turned) - 0.8).abs() < 0.01 && turned[0] > 0.59 && picture[3..] == [77; 3]);
        }
        let set = GoalSet::coloured();
        assert!((0..3).all(|k| set.code(k) == [1.0, 0.0, 0.0] && (set.hue(k) - SOUGHT).abs() < 1e-3));
        assert_eq!((GoalSet::named().turn(1), GoalSet::named().code(1)), (0.0, [0.0, 1.0, 0.0]));
    }

    #[test]
    fn goals_of_trainings_and_unseen_ones_share_no_shape_and_no_hue() {
        let mut random = Xoshiro256PlusPlus::new(4);
        let [low, high] = UNSEEN_HUES;
        let within = |goal: &Goal| (low..=high).contains(&hue(goal.colour));
        for _ in 0..40 {
            let trained = Goal::draw(GoalKind::Trained, 10, &mut random);
            assert!(trained.iter().all(|g| g.shape != Shape::Ball && !within(g)));
            assert!(trained.iter().all(|g| !(low..=high).contains(&hue(g.drawn))), "nor as drawn");
            let unseen = Goal::draw(GoalKind::Unseen, 4, &mut random);
            assert!(unseen.iter().all(|g| g.shape == Shape::Ball && within(g)));
        }
    }

    #[test]
    fn a_goal_fills_its_height_and_width() {
        let mut random = Xoshiro256PlusPlus::new(9);
        for kind in [GoalKind::Trained, GoalKind::Unseen] {
            for goal in Goal::draw(kind, 12, &mut random) {
                let mut cloud = GaussianCloud::default();
                let count = goal.add(&mut cloud, 1.0);
                cloud.check().unwrap();
                assert!(count == cloud.len() && (60..1500).contains(&count), "{count}");
                let most = |k: usize| cloud.means.iter().map(|p| f64::from(p[k].abs())).fold(0.0, f64::max);
                assert!(most(2) <= goal.height + 1e-6 && most(2) > 0.85 * goal.height, "{goal:?} {}", most(2));
                assert!(most(0) <= goal.half_width + 1e-6 && most(0) > 0.85 * goal.half_width, "{goal:?} {}", most(0));
            }
        }
    }

    #[test]
    fn words_and_pictures_say_a_colour() {
        assert_eq!(colour_of("#ff0000").unwrap(), [1.0, 0.0, 0.0]);
        assert!(colour_of("red").is_ok() && NAMED.iter().all(|(name, _)| colour_of(name).is_ok()));
        for bad in ["", "grey", "#ff00", "#808080", "#gg0000"] {
            assert!(colour_of(bad).unwrap_err().to_string().contains("goal"), "{bad}");
        }
        let mut picture = [90u8; 300].to_vec();
        picture.extend([200, 20, 20].repeat(40));
        picture.extend([200, 20, 40].repeat(40));
        picture.extend([20, 20, 200].repeat(50));
        let found = colour_of_picture(&picture).unwrap();
        assert!(found[0] > 0.7 && found[2] < 0.2, "{found:?}");
        assert!(colour_of_picture(&[90; 300]).is_err());
    }
}
