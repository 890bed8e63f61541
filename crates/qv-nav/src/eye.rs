//! What draws the pictures: the trait, and an eye that draws Gaussians.

use crate::NavError;
use crate::flat::{FIRST, add_flat};
use crate::goals::Goal;
use crate::net::{HEIGHT, WIDTH};
pub use crate::sight::LINEAR;
use crate::sight::{COLOURS, Cone};
use glam::{DQuat, DVec3};
use qv_core::random::Xoshiro256PlusPlus;
use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Outputs, Scene, Settings, View, render};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// One picture to be drawn.
#[derive(Debug, Clone)]
pub struct Shot {
    /// The camera, of [`WIDTH`] x [`HEIGHT`].
    pub camera: Camera,
    /// What stands in the place.
    pub cones: Vec<Cone>,
    /// Of the episode, for an eye that looks different from one to the next.
    pub seed: u64,
}

/// Draws pictures. It may be asked to on any thread of rayon's pool, while robots decide and go on; so no lock may be held across work of the pool.
pub trait Eye: Sync {
    /// For each shot red, green, blue as shown, 0 to 1, shape `[HEIGHT, WIDTH, 3]`; without what the camera model adds.
    ///
    /// # Errors
    /// When a picture cannot be drawn.
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError>;
}

/// An eye that is a function of one shot: for renderers that this crate does not know.
pub struct FnEye<F>(pub F);

impl<F: Fn(&Shot) -> Vec<f32> + Sync> Eye for FnEye<F> {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        Ok(shots.par_iter().map(&self.0).collect())
    }
}

/// One of several eyes for each episode, such as reconstructions of a place that are not equally fine: what a policy takes for granted of one, the
/// next one lacks.
pub struct Several<'a>(pub Vec<Box<dyn Eye + 'a>>);

impl Several<'_> {
    /// Which eye an episode has.
    fn of(&self, shot: &Shot) -> usize {
        (shot.seed >> 32) as usize % self.0.len()
    }
}

impl Eye for Several<'_> {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        if self.0.is_empty() {
            return Err(NavError::value("eyes", "at least one", "none"));
        }
        let mut out = vec![Vec::new(); shots.len()];
        for (k, eye) in self.0.iter().enumerate() {
            let chosen: Vec<usize> = (0..shots.len()).filter(|&s| self.of(&shots[s]) == k).collect();
            if chosen.is_empty() {
                continue;
            }
            let own: Vec<Shot> = chosen.iter().map(|&s| shots[s].clone()).collect();
            for (s, picture) in chosen.into_iter().zip(eye.look(&own)?) {
                out[s] = picture;
            }
        }
        Ok(out)
    }
}

/// An eye that sees grey everywhere: for a policy that must do without.
pub struct BlindEye;

impl Eye for BlindEye {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        Ok(shots.iter().map(|_| vec![0.5; WIDTH * HEIGHT * 3]).collect())
    }
}

/// Looks of each colour in [`SplatEye`]: brightness, the factor on the middle channel, which turns the hue by up to 5 degrees, and the width.
const LOOKS: [(f64, f64, f64); 4] = [(0.55, 1.0, 0.92), (0.85, 1.3, 1.0), (1.1, 0.75, 0.96), (1.5, 1.0, 0.96)];

/// Draws a cloud of Gaussians with cones in it, on the CPU. Cones are Gaussians of their own which move as groups; they are all 0.45 m high.
pub struct SplatEye {
    /// The place in several paints; an episode has one of them.
    clouds: Vec<GaussianCloud>,
    group_of: Vec<u32>,
    looks: Looks,
    /// What is behind everything.
    background: [f32; 3],
    antialias: bool,
}

/// How the paints of a place differ, see [`SplatEye::painted`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Paints {
    /// How many.
    pub count: usize,
    /// Greatest deviation of the logarithm of single Gaussians' brightness: texture that a small cloud does not have.
    pub grain: f32,
    /// Deviation of the logarithm of the brightness of single channels of all of them.
    pub tint: f32,
}

impl Default for Paints {
    fn default() -> Self {
        Self { count: 8, grain: 0.35, tint: 0.08 }
    }
}

impl SplatEye {
    /// Over the cloud of a place.
    pub fn new(place: &GaussianCloud) -> Self {
        Self::painted(place, &Paints { count: 1, grain: 0.0, tint: 0.0 }, 0)
    }

    /// The same with the place, not the cones, painted otherwise from episode to episode, so that a network does not take for granted how
    /// smooth a small cloud is. The first paint is the cloud's own.
    pub fn painted(place: &GaussianCloud, paints: &Paints, seed: u64) -> Self {
        let paint = |k| paint(place, paints, (k, seed));
        Self::over((0..paints.count.max(1)).map(paint).collect())
    }

    /// Over the cloud of a place in several paints, of which an episode has one. They differ in colours alone.
    pub(crate) fn over(mut clouds: Vec<GaussianCloud>) -> Self {
        let mut group_of = Vec::new();
        for cloud in &mut clouds {
            group_of = Self::add_cones(cloud);
        }
        Self { clouds, group_of, looks: Looks::CONES, background: SKY, antialias: false }
    }

    /// The same with other goals than cones of three colours, each of one look. `seed` draws how bright each is.
    pub fn with_goals(mut clouds: Vec<GaussianCloud>, goals: &[Goal], seed: u64) -> Self {
        let mut group_of = Vec::new();
        for (paint, cloud) in clouds.iter_mut().enumerate() {
            group_of = vec![0; cloud.len()];
            for (k, goal) in goals.iter().enumerate() {
                let mut random = Xoshiro256PlusPlus::of(seed, 97, (paint * goals.len() + k) as u64);
                let brightness = f64::from(random.between(-0.5, 0.4).exp());
                let count = goal.add(cloud, brightness);
                group_of.extend(std::iter::repeat_n(1 + k as u32, count));
            }
        }
        let looks = Looks { kinds: goals.len(), each: 1 };
        Self { clouds, group_of, looks, background: SKY, antialias: false }
    }

    /// The place of this eye with other goals, see [`SplatEye::with_goals`].
    pub fn having(self, goals: &[Goal], seed: u64) -> Self {
        let still: Vec<bool> = self.group_of.iter().map(|group| *group == 0).collect();
        let clouds = self.clouds.iter().map(|cloud| cloud.filtered(|k| still[k])).collect();
        let Self { background, antialias, .. } = self;
        Self { background, antialias, ..Self::with_goals(clouds, goals, seed) }
    }

    /// The same, drawn as the scene of its place was made to be drawn: over its background (red, green, blue as shown, 0 to 1), and with
    /// anti-aliasing or without. Where Gaussians let the background through, they have the right colour over that one alone. A scene that was made
    /// over black, or does not say over what, stands before a sky: black is the colour of no place, and what is left empty is most often sky. So does
    /// one whose background is no colour. Anti-aliasing draws the cones, too, a little smaller and fainter where they are far.
    pub fn as_made(self, background: Option<[f32; 3]>, antialias: bool) -> Self {
        let is_colour = |colour: &[f32; 3]| colour.iter().all(|c| (0.0..=1.0).contains(c)) && *colour != [0.0; 3];
        let background = background.filter(is_colour).unwrap_or(SKY);
        Self { background, antialias, ..self }
    }

    /// Adds all looks of all cones; says the group of each Gaussian.
    fn add_cones(cloud: &mut GaussianCloud) -> Vec<u32> {
        let mut group_of = vec![0; cloud.len()];
        for colour in 0..COLOURS.len() {
            for (brightness, hue, wide) in LOOKS {
                let group = 1 + group_of.last().copied().unwrap_or(0);
                let linear = LINEAR[colour];
                let middle = if colour == 1 { 1 } else { 2 };
                let shade = |k: usize| brightness * linear[k] * if k == middle { hue } else { 1.0 };
                let count = add_cone(cloud, [shade(0), shade(1), shade(2)], wide);
                group_of.extend(std::iter::repeat_n(group, count));
            }
        }
        group_of
    }

    /// What of a shot's picture its cones are: their colours times their share of each pixel, then that share, shape `[HEIGHT, WIDTH, 4]`.
    /// The place hides what is behind it.
    ///
    /// # Errors
    /// When the picture cannot be drawn.
    pub(crate) fn cones_of(&self, shot: &Shot) -> Result<Vec<f32>, NavError> {
        let mut cloud = self.clouds[Self::paint_of(shot, self.clouds.len())].clone();
        let bands = cloud.sh_count();
        let colour = |k: usize| cloud.sh[k * bands].map(|c| (0.5 + FIRST * c).max(0.0));
        let of = |(k, group): (usize, &u32)| match group {
            0 => [0.0; 4],
            _ => [colour(k)[0], colour(k)[1], colour(k)[2], 1.0],
        };
        cloud.features = self.group_of.iter().enumerate().flat_map(of).collect();
        cloud.feature_count = 4;
        let environments = [self.looks.groups(&shot.cones)];
        let scene = Scene { cloud: &cloud, group_of: &self.group_of, environments: &environments };
        let outputs = Outputs { features: true, ..Default::default() };
        let settings = Settings { outputs, antialias: self.antialias, ..Default::default() };
        let view = View { camera: finer(&shot.camera), environment: 0 };
        let image = render(&scene, &[view], &settings)?.0.remove(0);
        Ok(averaged(&image.features, shot.camera.width as usize, 4))
    }

    /// Which share of its cones in the picture a shot shows, 0 to 1: the place hides the rest. 0 where no cone is in the picture.
    ///
    /// # Errors
    /// When the picture cannot be drawn.
    pub fn shown(&self, shot: &Shot) -> Result<f64, NavError> {
        let alone = self.clouds[0].filtered(|k| self.group_of[k] != 0);
        let group_of = self.group_of.iter().copied().filter(|group| *group != 0).collect();
        let alone = Self { clouds: vec![alone], group_of, ..*self };
        let cover = |eye: &Self| -> Result<f64, NavError> {
            Ok(eye.cones_of(shot)?.chunks_exact(4).map(|pixel| f64::from(pixel[3])).sum())
        };
        let whole = cover(&alone)?;
        Ok(if whole > 0.0 { cover(self)? / whole } else { 0.0 })
    }

    /// Gaussians that are drawn, those of the cones included.
    pub fn count(&self) -> usize {
        self.clouds[0].len()
    }

    /// The place in its paints, cones behind it, and the group of each Gaussian.
    #[cfg(feature = "gpu")]
    pub(crate) fn parts(&self) -> (&[GaussianCloud], &[u32]) {
        (&self.clouds, &self.group_of)
    }

    /// How pictures are drawn.
    pub(crate) fn settings(&self) -> Settings {
        Settings { background: self.background, antialias: self.antialias, ..Default::default() }
    }

    /// Which of some paints the episode of a shot has.
    pub(crate) fn paint_of(shot: &Shot, paints: usize) -> usize {
        (shot.seed >> 8) as usize % paints
    }

    /// How goals are counted as groups.
    #[cfg(feature = "gpu")]
    pub(crate) fn looks(&self) -> Looks {
        self.looks
    }
}

/// Goals as groups of Gaussians: so many kinds, and looks of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Looks {
    kinds: usize,
    each: usize,
}

impl Looks {
    const CONES: Self = Self { kinds: COLOURS.len(), each: LOOKS.len() };

    /// Poses of the cones by group.
    pub(crate) fn groups(self, cones: &[Cone]) -> Vec<Option<Pose>> {
        let mut groups = vec![None; self.kinds * self.each];
        for cone in cones.iter().filter(|_| self.kinds > 0) {
            let rotation = DQuat::from_rotation_z(cone.turn);
            let at = cone.colour.min(self.kinds - 1) * self.each + cone.look % self.each;
            groups[at] = Some(Pose { position: DVec3::from(cone.place), rotation });
        }
        groups
    }
}

impl Eye for SplatEye {
    fn look(&self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, NavError> {
        let mut out = vec![Vec::new(); shots.len()];
        for (k, cloud) in self.clouds.iter().enumerate() {
            let has = |s: &usize| Self::paint_of(&shots[*s], self.clouds.len()) == k;
            let chosen: Vec<usize> = (0..shots.len()).filter(has).collect();
            if chosen.is_empty() {
                continue;
            }
            let environments: Vec<Vec<Option<Pose>>> =
                chosen.iter().map(|&s| self.looks.groups(&shots[s].cones)).collect();
            let scene = Scene { cloud, group_of: &self.group_of, environments: &environments };
            let view = |(environment, &s): (usize, &usize)| View { camera: finer(&shots[s].camera), environment };
            let views: Vec<View> = chosen.iter().enumerate().map(view).collect();
            let settings = self.settings();
            let (images, _) = render(&scene, &views, &settings)?;
            for (s, image) in chosen.into_iter().zip(images) {
                out[s] = averaged(&image.colour, shots[s].camera.width as usize, 3);
            }
        }
        Ok(out)
    }
}

/// Sky, where nothing is: what reconstructions leave empty is most often that.
const SKY: [f32; 3] = [0.75, 0.82, 0.9];

/// Rays of a pixel along rows and columns: a pixel of a camera is a mean over its area, and drawing widens a Gaussian by half a pixel.
pub(crate) const FINER: usize = 2;

/// The same camera with more pixels.
pub(crate) fn finer(camera: &Camera) -> Camera {
    let factor = FINER as f64;
    Camera {
        width: camera.width * FINER as u32,
        height: camera.height * FINER as u32,
        fx: camera.fx * factor,
        fy: camera.fy * factor,
        cx: camera.cx * factor,
        cy: camera.cy * factor,
        ..*camera
    }
}

/// Means of squares of a picture that was drawn by a finer camera; `width` is that of the result.
fn averaged(picture: &[f32], width: usize, channels: usize) -> Vec<f32> {
    let row = channels * width * FINER;
    let mut out = Vec::with_capacity(picture.len() / (FINER * FINER));
    for rows in picture.chunks_exact(row * FINER) {
        for k in 0..channels * width {
            let first = k / channels * channels * FINER + k % channels;
            let square = (0..FINER * FINER).map(|j| rows[j / FINER * row + first + j % FINER * channels]);
            out.push(square.sum::<f32>() / (FINER * FINER) as f32);
        }
    }
    out
}

/// The cloud of a place in another paint.
fn paint(cloud: &GaussianCloud, paints: &Paints, (index, seed): (usize, u64)) -> GaussianCloud {
    let mut out = cloud.clone();
    if index == 0 {
        return out;
    }
    let mut random = Xoshiro256PlusPlus::of(seed, 95, index as u64);
    let grain = paints.grain * index as f32 / (paints.count - 1) as f32;
    let tint = [0; 3].map(|_| (paints.tint * random.normal()).exp());
    let bands = out.sh_count();
    for colour in out.sh.chunks_exact_mut(bands) {
        let factor = (grain * random.normal()).exp();
        for (c, tint) in colour[0].iter_mut().zip(tint) {
            let shown = (0.5 + FIRST * *c).max(0.0) * factor * tint;
            *c = (shown.min(1.0) - 0.5) / FIRST;
        }
    }
    out
}

/// Adds a cone of 0.45 m as flat Gaussians, lit from one side; gives their number.
fn add_cone(cloud: &mut GaussianCloud, linear: [f64; 3], wide: f64) -> usize {
    const TALL: f64 = 0.45;
    const WIDE: f64 = 0.10;
    const ROWS: usize = 16;
    let before = cloud.len();
    for row in 0..ROWS {
        // The lowest row is near the ground, so that the foot is where it should be.
        let up = (row as f64 + 0.3) / ROWS as f64;
        let radius = WIDE * wide * (1.0 - up);
        let around = (TAU * radius / 0.02).round().max(4.0) as usize;
        for k in 0..around {
            let out = DVec3::new((TAU * k as f64 / around as f64).cos(), (TAU * k as f64 / around as f64).sin(), 0.0);
            let normal = (out * TALL + DVec3::Z * WIDE).normalize();
            let across = DVec3::Z.cross(out);
            let place = out * radius + DVec3::Z * (up * TALL);
            let scales = [(0.5 * TAU * radius / around as f64).max(0.003), 0.012, 0.002].map(|s| s.ln() as f32);
            add_flat(cloud, place, [across, normal], scales, linear);
        }
    }
    cloud.len() - before
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sight::Rig;
    use glam::DVec2;

    #[test]
    fn a_cone_is_drawn_where_it_stands_in_its_colour() {
        let eye = SplatEye::new(&GaussianCloud::default());
        let base = Pose::from_xyz_rpy([0.0, 0.0, 0.3], [0.0; 3]);
        let camera = Rig::default().camera(&base);
        let cone = |colour, y| Cone { place: [1.5, y, 0.0], height: 0.45, colour, look: 1, turn: 1.0 };
        let shots = [vec![cone(0, 0.0)], vec![cone(1, 0.3)], vec![]];
        let shots: Vec<Shot> = shots.into_iter().map(|cones| Shot { camera, cones, seed: 0 }).collect();
        let images = eye.look(&shots).unwrap();
        let like = |image: &[f32], test: fn(&[f32]) -> bool| -> Vec<usize> {
            image.chunks_exact(3).enumerate().filter(|(_, p)| test(p)).map(|(k, _)| k % WIDTH).collect()
        };
        let red = like(&images[0], |p| p[0] > 2.0 * p[1] && p[0] > 2.0 * p[2]);
        let blue = like(&images[1], |p| p[2] > 1.7 * p[0] && p[2] > 1.4 * p[1]);
        let mean = |columns: &[usize]| columns.iter().sum::<usize>() as f64 / columns.len().max(1) as f64;
        assert!(red.len() > 60 && (mean(&red) - 39.5).abs() < 1.5, "{} {}", red.len(), mean(&red));
        // To the left is a smaller column: 0.3 m at 1.2 m.
        assert!(blue.len() > 60 && (mean(&blue) - (39.5 - 76.9 * 0.25)).abs() < 2.0, "{} {}", blue.len(), mean(&blue));
        assert!(images[2].chunks_exact(3).all(|p| p == [0.75, 0.82, 0.9]));
    }

    #[test]
    fn a_scene_is_drawn_as_it_was_made() {
        // A cone of one colour as the place, and a camera that sees more than it.
        let mut place = GaussianCloud::default();
        add_cone(&mut place, [0.3; 3], 1.0);
        let camera = Rig::default().camera(&Pose::from_xyz_rpy([-1.5, 0.0, 0.3], [0.0; 3]));
        let shot = Shot { camera, cones: vec![], seed: 0 };
        let picture = |eye: SplatEye| eye.look(std::slice::from_ref(&shot)).unwrap().remove(0);
        let plain = || SplatEye::new(&place);
        let over = picture(plain().as_made(Some([0.2, 0.4, 0.6]), false));
        assert_eq!(over[..3], [0.2, 0.4, 0.6]);
        let sky = picture(plain());
        assert_eq!(sky[..3], SKY);
        assert!(
            over.chunks_exact(3)
                .zip(sky.chunks_exact(3))
                .any(|(a, b)| a != [0.2, 0.4, 0.6] && (a[0] - b[0]).abs() < 0.01)
        );
        // Black is no colour of a place, and a file may say nothing.
        for background in [Some([0.0; 3]), None, Some([0.5, f32::NAN, 0.5]), Some([0.5, 2.0, 0.5])] {
            assert!(picture(plain().as_made(background, false)) == sky, "{background:?}");
        }
        // Far away a Gaussian is smaller than a pixel: without anti-aliasing it is drawn too large.
        let drawn =
            |antialias| picture(plain().as_made(Some([1.0; 3]), antialias)).iter().map(|x| 1.0 - x).sum::<f32>();
        assert!(drawn(true) < drawn(false), "{} {}", drawn(true), drawn(false));
    }

    #[test]
    fn each_episode_has_one_of_several_eyes() {
        let plain = |shade: f32| -> Box<dyn Eye> { Box::new(FnEye(move |shot: &Shot| vec![shade, shot.seed as f32])) };
        let camera = Rig::default().camera(&Pose::IDENTITY);
        let shots: Vec<Shot> = (0..6).map(|k| Shot { camera, cones: Vec::new(), seed: (k << 32) + 7 * k }).collect();
        let seen = Several(vec![plain(0.1), plain(0.2), plain(0.3)]).look(&shots).unwrap();
        let shades: Vec<f32> = seen.iter().map(|picture| picture[0]).collect();
        assert_eq!(shades, [0.1, 0.2, 0.3, 0.1, 0.2, 0.3]);
        assert!(seen.iter().zip(&shots).all(|(picture, shot)| picture[1] == shot.seed as f32), "each in its place");
        assert!(Several(Vec::new()).look(&shots).is_err());
    }

    #[test]
    fn cones_are_as_large_as_they_should_be() {
        let eye = SplatEye::new(&GaussianCloud::default());
        let base = Pose::from_xyz_rpy([0.0, 0.0, 0.3], [0.0; 3]);
        let camera = Rig::default().camera(&base);
        // Drawing adds about half a pixel at each side, which is a large share of a cone far away.
        for (distance, most) in [(0.45, 1.12), (0.8, 1.25), (1.6, 1.3)] {
            let cone = |look| Cone { place: [0.3 + distance, 0.0, 0.0], height: 0.45, colour: 0, look, turn: 0.0 };
            let shots: Vec<Shot> = (0..4).map(|k| Shot { camera, cones: vec![cone(k)], seed: 0 }).collect();
            // Pixels whose centre lies within the triangle of foot and tip.
            let project = |x: f64, up: f64| {
                let p = camera.camera_from_world.transform_point(DVec3::new(0.3 + distance, x, up));
                DVec2::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy)
            };
            let corners = [project(0.1, 0.0), project(-0.1, 0.0), project(0.0, 0.45)];
            let inside = |p: DVec2| {
                let side = |a: DVec2, b: DVec2| (b - a).perp_dot(p - a);
                let sides = [side(corners[0], corners[1]), side(corners[1], corners[2]), side(corners[2], corners[0])];
                sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
            };
            let pixels = (0..WIDTH * HEIGHT).map(|k| DVec2::new((k % WIDTH) as f64 + 0.5, (k / WIDTH) as f64 + 0.5));
            let expected = pixels.filter(|p| inside(*p)).count() as f64;
            let red =
                |image: &Vec<f32>| image.chunks_exact(3).filter(|p| p[0] > 1.8 * p[1] && p[0] > 1.8 * p[2]).count();
            let found = eye.look(&shots).unwrap().iter().map(red).sum::<usize>() as f64 / 4.0;
            let share = found / expected;
            assert!((0.95..most).contains(&share), "{distance}: {found} for {expected}");
        }
    }

    #[test]
    fn paints_change_the_place_and_no_cone() {
        let mut place = GaussianCloud::default();
        add_cone(&mut place, [0.3; 3], 1.0);
        let paints = Paints { count: 3, ..Paints::default() };
        let (plain, painted) = (SplatEye::new(&place), SplatEye::painted(&place, &paints, 5));
        assert_eq!(painted.clouds.len(), 3);
        assert_eq!(painted.clouds[0], plain.clouds[0]);
        for cloud in &painted.clouds[1..] {
            let (own, cones) = cloud.sh.split_at(place.sh.len());
            assert!(own != place.sh && *cones == plain.clouds[0].sh[place.sh.len()..]);
        }
        let base = Pose::from_xyz_rpy([-1.5, 0.0, 0.3], [0.0; 3]);
        let shot = |seed| Shot { camera: Rig::default().camera(&base), cones: vec![], seed };
        let images = painted.look(&[shot(0), shot(1 << 8), shot(3 << 8), shot(0)]).unwrap();
        assert!(images[0] == images[2] && images[0] == images[3] && images[0] != images[1]);
    }
}
