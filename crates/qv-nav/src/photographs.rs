//! The same view photographed and drawn, with a cone in both: what a network says of the one beside what it says of the other.
//!
//! A policy learns from pictures that are drawn, and walks by pictures that are taken. Photographs of the place that the reconstruction did not
//! learn from show whether that matters, before a robot walks. A cone that no photograph shows is laid into both pictures alike.

use crate::NavError;
use crate::eye::{Eye, Shot, SplatEye};
use crate::goals::turn_hues;
use crate::net::{HEIGHT, HIDDEN, Net, NetInput, Scratch, WIDTH};
use crate::recall::RECALL;
use crate::roll::{sight, state_of};
use crate::score::{mcnemar, wilson};
use crate::sight::{COLOURS, Cone, SEEN, free_rays};
use crate::sizes::SIGHT;
use crate::teacher::World;
use glam::DVec3;
use qv_core::random::Xoshiro256PlusPlus;
use qv_core::{Camera, Pose, statistics};
use serde::{Deserialize, Serialize};

/// A photograph of the place without distortion.
#[derive(Debug, Clone)]
pub struct Photograph {
    /// How it was taken.
    pub camera: Camera,
    /// Colours 0 to 1, shape `[height, width, 3]`.
    pub colours: Vec<f32>,
    /// Which pixels show something, shape `[height, width]`.
    pub valid: Vec<bool>,
}

/// One view, photographed and drawn.
#[derive(Debug, Clone)]
pub struct Pair {
    /// The base that would carry the camera.
    pub base: Pose,
    /// What was laid into both; none where there is nothing to find.
    pub goal: Option<Cone>,
    /// Bytes, shape `[HEIGHT, WIDTH, 3]`.
    pub photographed: Vec<u8>,
    /// See `photographed`.
    pub drawn: Vec<u8>,
}

/// What a network says of one kind of picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PictureScores {
    /// Views with a cone in which it says that it sees it.
    pub seen: usize,
    /// Their share, and Wilson's interval of 95 %.
    pub share: f64,
    /// See `share`.
    pub interval: [f64; 2],
    /// Median of how far its bearing is off where it is seen \[rad\]; none where none is.
    #[serde(rename = "bearing_rad")]
    pub bearing: Option<f64>,
    /// Median of the absolute natural logarithm of its distance over the true one.
    #[serde(rename = "distance_log")]
    pub distance: Option<f64>,
    /// Questions for a colour in views without a cone to which it says that it sees one.
    pub imagined: usize,
}

/// Both kinds beside each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Views with a cone.
    pub views: usize,
    /// Questions for a colour in views without one.
    pub questions: usize,
    /// Of drawn pictures.
    pub drawn: PictureScores,
    /// Of photographs.
    pub photographed: PictureScores,
    /// McNemar's exact p of whether the cone is seen.
    pub p: f64,
}

/// From a cone's middle to the camera at most, along the ground \[m\]: beyond it is a few pixels high.
const FARTHEST: f64 = 5.0;

/// Views of a photograph: one without a cone, and up to `cones` with one, each on ground where one may stand. [`SEEN`] rays of nine to it are free
/// on the map, and the scene shows as large a share of it: a mesh may lack what hides it. None where the photograph does not fill the network's
/// picture, whose view is that of the rig at the photograph's pose.
///
/// # Errors
/// When a picture cannot be drawn.
pub fn pairs(
    world: &World,
    eye: &SplatEye,
    photograph: &Photograph,
    cones: usize,
    seed: u64,
) -> Result<Vec<Pair>, NavError> {
    let world_from_camera = photograph.camera.camera_from_world.inverse();
    let base = world_from_camera * world.rig.base_from_camera().inverse();
    let camera = world.rig.camera(&base);
    let Some(plain) = reduced(photograph, &camera) else { return Ok(vec![]) };
    let mut random = Xoshiro256PlusPlus::of(seed, 61, 0);
    let goals = goals(world, eye, &camera, cones, &mut random)?;
    let mut out = Vec::with_capacity(goals.len() + 1);
    for goal in std::iter::once(None).chain(goals.into_iter().map(Some)) {
        let shot = Shot { camera, cones: goal.into_iter().collect(), seed: 0 };
        let drawn = eye.look(std::slice::from_ref(&shot))?.remove(0);
        let photographed = match goal {
            Some(_) => laid_over(&plain, &eye.cones_of(&shot)?),
            None => plain.clone(),
        };
        out.push(Pair { base, goal, photographed: bytes(&photographed), drawn: bytes(&drawn) });
    }
    Ok(out)
}

/// Cones that can be seen, colours in turn.
fn goals(
    world: &World,
    eye: &SplatEye,
    camera: &Camera,
    count: usize,
    random: &mut Xoshiro256PlusPlus,
) -> Result<Vec<Cone>, NavError> {
    let from = camera.camera_from_world.inverse().position;
    let near = |place: &&DVec3| place.truncate().distance(from.truncate()) < FARTHEST;
    let is_shown = |goal: Cone| -> Result<bool, NavError> {
        Ok(eye.shown(&Shot { camera: *camera, cones: vec![goal], seed: 0 })? >= SEEN as f64 / 9.0)
    };
    let mut places: Vec<DVec3> = world.candidates.iter().filter(near).copied().collect();
    let mut out = Vec::new();
    while out.len() < count && !places.is_empty() {
        let place = places.swap_remove(random.below(places.len())).to_array();
        let turn = f64::from(random.between(0.0, std::f32::consts::TAU));
        let goal = Cone { place, height: 0.45, colour: out.len() % COLOURS.len(), look: 0, turn };
        if free_rays(&world.map, camera, &goal, true) >= SEEN && is_shown(goal)? {
            out.push(goal);
        }
    }
    Ok(out)
}

/// A photograph as a camera at its pose sees it, shape `[HEIGHT, WIDTH, 3]`: means over the area of each pixel. None where it does not reach so far.
fn reduced(photograph: &Photograph, camera: &Camera) -> Option<Vec<f32>> {
    let of = &photograph.camera;
    // At least one sample for each pixel of the photograph.
    let samples = (of.fx.max(of.fy) / camera.fx).ceil().clamp(1.0, 64.0) as usize;
    let place = |k: usize, j: usize| k as f64 + (j as f64 + 0.5) / samples as f64;
    let along = |k: usize, j: usize| of.fx * (place(k, j) - camera.cx) / camera.fx + of.cx;
    let down = |k: usize, j: usize| of.fy * (place(k, j) - camera.cy) / camera.fy + of.cy;
    let within = |x: f64, sides: u32| (x >= 0.0 && x < f64::from(sides)).then_some(x as usize);
    let mut out = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for (row, column) in (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column))) {
        let mut sum = [0.0; 3];
        for (j, i) in (0..samples).flat_map(|j| (0..samples).map(move |i| (j, i))) {
            let (v, u) = (within(down(row, j), of.height)?, within(along(column, i), of.width)?);
            let pixel = v * of.width as usize + u;
            if !photograph.valid[pixel] {
                return None;
            }
            sum.iter_mut().zip(&photograph.colours[3 * pixel..][..3]).for_each(|(sum, c)| *sum += c);
        }
        out.extend(sum.map(|sum| sum / (samples * samples) as f32));
    }
    Some(out)
}

/// Cones of [`SplatEye::cones_of`] over a picture.
fn laid_over(picture: &[f32], cones: &[f32]) -> Vec<f32> {
    let mixed = |(below, over): (&[f32], &[f32])| [0, 1, 2].map(|k| below[k] * (1.0 - over[3]) + over[k]);
    picture.chunks_exact(3).zip(cones.chunks_exact(4)).flat_map(mixed).collect()
}

fn bytes(picture: &[f32]) -> Vec<u8> {
    picture.iter().map(|x| (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8).collect()
}

/// What a network says of a picture's cone: whether it is seen, how far bearing \[rad\] and logarithm of the distance are off.
struct ConeAnswer {
    is_seen: bool,
    off: Option<(f64, f64)>,
}

/// A picture as a network sees it that is asked for a goal.
fn turned(world: &World, picture: &[u8], colour: usize) -> Vec<f32> {
    let mut bytes = picture.to_vec();
    turn_hues(&mut bytes, world.goals.turn(colour));
    bytes.into_iter().map(f32::from).collect()
}

/// What a network says of one picture when it is asked for one goal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PictureAnswer {
    /// How sure it is that the goal is in view, 0 to 1; above 0.5 it says so.
    pub sure: f64,
    /// Bearing of the goal from the base's heading \[rad\], positive to the left.
    pub bearing_rad: f64,
    /// Distance of the goal from the base \[m\].
    pub distance_m: f64,
}

/// A question about a pair, and both answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// Index of the pair.
    pub pair: usize,
    /// Colour that was asked for, see [`COLOURS`].
    pub colour: String,
    /// Whether a cone of this colour is in the pictures.
    pub is_there: bool,
    /// Of the photograph.
    pub photographed: PictureAnswer,
    /// Of the drawn picture.
    pub drawn: PictureAnswer,
}

/// What a network says of one picture when it is asked for a colour.
fn said_of(
    world: &World,
    (net, parameters, scratch): (&Net, &[f32], &mut Scratch),
    (pair, picture, colour): (&Pair, &[u8], usize),
) -> [f64; SIGHT] {
    let picture = turned(world, picture, colour);
    let state = state_of(world.goals.code(colour), &pair.base);
    let sees = NetInput { picture: &picture, state: &state, recall: &[0.0; RECALL] };
    net.step(parameters, &sees, &mut [0.0; HIDDEN], scratch).sight.map(f64::from)
}

/// What a network says of each picture: of those with a cone when it is asked for its colour, of the others when it is asked for all colours.
pub fn questions(world: &World, net: &Net, parameters: &[f32], pairs: &[Pair]) -> Vec<Question> {
    let mut scratch = net.scratch();
    let mut ask = |pair: &Pair, picture: &[u8], colour: usize| {
        let said = said_of(world, (net, parameters, &mut scratch), (pair, picture, colour));
        PictureAnswer { sure: said[3], bearing_rad: said[0].atan2(said[1]), distance_m: said[2].exp() }
    };
    let mut out = Vec::new();
    for (k, pair) in pairs.iter().enumerate() {
        for colour in (0..COLOURS.len()).filter(|c| pair.goal.is_none_or(|goal| goal.colour == *c)) {
            out.push(Question {
                pair: k,
                colour: COLOURS[colour].into(),
                is_there: pair.goal.is_some(),
                photographed: ask(pair, &pair.photographed, colour),
                drawn: ask(pair, &pair.drawn, colour),
            });
        }
    }
    out
}

/// Asks both pictures of each pair.
pub fn agreement(world: &World, net: &Net, parameters: &[f32], pairs: &[Pair]) -> Agreement {
    let mut scratch = net.scratch();
    let mut ask = |pair: &Pair, picture: &[u8], colour: usize| {
        let said = said_of(world, (net, parameters, &mut scratch), (pair, picture, colour));
        let off = pair.goal.map(|goal| {
            let truth = sight(world, &pair.base, &goal, &[]).map(f64::from);
            let turn = said[0].atan2(said[1]) - truth[0].atan2(truth[1]);
            (turn.sin().atan2(turn.cos()).abs(), (said[2] - truth[2]).abs())
        });
        ConeAnswer { is_seen: said[3] > 0.5, off }
    };
    let mut of = |kind: fn(&Pair) -> &[u8]| {
        let (mut with, mut imagined) = (Vec::new(), 0);
        for pair in pairs {
            match pair.goal {
                Some(goal) => with.push(ask(pair, kind(pair), goal.colour)),
                None => imagined += (0..COLOURS.len()).filter(|c| ask(pair, kind(pair), *c).is_seen).count(),
            }
        }
        (with, imagined)
    };
    let (drawn, photographed) = (of(|pair| &pair.drawn), of(|pair| &pair.photographed));
    let only = |a: &[ConeAnswer], b: &[ConeAnswer]| a.iter().zip(b).filter(|(a, b)| a.is_seen && !b.is_seen).count();
    let views = drawn.0.len();
    Agreement {
        views,
        questions: (pairs.len() - views) * COLOURS.len(),
        p: mcnemar(only(&drawn.0, &photographed.0), only(&photographed.0, &drawn.0)),
        drawn: found(&drawn.0, drawn.1),
        photographed: found(&photographed.0, photographed.1),
    }
}

fn found(said: &[ConeAnswer], imagined: usize) -> PictureScores {
    let seen: Vec<(f64, f64)> = said.iter().filter(|s| s.is_seen).filter_map(|s| s.off).collect();
    let middle = |which: fn(&(f64, f64)) -> f64| {
        let mut off: Vec<f64> = seen.iter().map(which).collect();
        (!off.is_empty()).then(|| statistics::median(&mut off))
    };
    PictureScores {
        seen: seen.len(),
        share: seen.len() as f64 / said.len().max(1) as f64,
        interval: wilson(seen.len(), said.len()),
        bearing: middle(|off| off.0),
        distance: middle(|off| off.1),
        imagined,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bare::Bare;
    use crate::map::{Map, MapSettings, tests::ring};
    use crate::sight::Rig;
    use crate::task::Limits;

    /// A photograph that is the drawn view itself, eight times as fine, gives the drawn picture, with and without a cone.
    #[test]
    fn a_photograph_of_the_drawn_view_is_the_drawn_view() {
        let map = Map::new(&ring(), &MapSettings::default()).unwrap();
        let world = World::new(map, Rig::default(), Limits::default());
        let eye = SplatEye::bare(&ring(), &Bare { spacing: 0.05, paints: 1 }, 7).unwrap();
        let base = Pose::from_xyz_rpy([-2.3, -2.3, 0.3], [0.02, 0.01, 0.8]);
        let small = world.rig.camera(&base);
        let pixels = WIDTH * HEIGHT;
        let plain = eye.look(&[Shot { camera: small, cones: vec![], seed: 0 }]).unwrap().remove(0);
        let times = 4;
        let large = Camera {
            fx: small.fx * times as f64,
            fy: small.fy * times as f64,
            cx: small.cx * times as f64,
            cy: small.cy * times as f64,
            width: small.width * times as u32,
            height: small.height * times as u32,
            ..small
        };
        let at = |row: usize, column: usize| 3 * (row / times * WIDTH + column / times);
        let rows = (0..HEIGHT * times).flat_map(|row| (0..WIDTH * times).map(move |column| (row, column)));
        let colours = rows.flat_map(|(row, column)| plain[at(row, column)..][..3].to_vec()).collect();
        let photograph = Photograph { camera: large, colours, valid: vec![true; pixels * times * times] };
        let found = pairs(&world, &eye, &photograph, 4, 3).unwrap();
        assert!(found.len() > 2 && found[0].goal.is_none() && found[1..].iter().all(|p| p.goal.is_some()));
        for pair in &found {
            let worst = pair.photographed.iter().zip(&pair.drawn).map(|(a, b)| a.abs_diff(*b)).max();
            // A cone's edge lies over a mean of what is behind it, not over what is behind each ray.
            assert!(worst <= Some(if pair.goal.is_some() { 12 } else { 1 }), "{worst:?}");
        }
        let changed =
            |pair: &Pair| pair.drawn.iter().zip(&found[0].drawn).filter(|(a, b)| a.abs_diff(**b) > 20).count();
        assert!(found[1..].iter().all(|pair| changed(pair) > 6), "a cone is to be seen");
        // A wall that the mesh lacks hides the cones behind it.
        let forward = base.rotation * DVec3::X;
        let mut walled = ring();
        let first = walled.vertices.len() as u32;
        walled.vertices.extend([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(|(aside, up)| {
            base.position + 0.6 * forward + aside * DVec3::new(-forward.y, forward.x, 0.0) + up * DVec3::Z
        }));
        walled.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        let behind = SplatEye::bare(&walled, &Bare { spacing: 0.05, paints: 1 }, 7).unwrap();
        let shot = |goal| Shot { camera: small, cones: vec![goal], seed: 0 };
        let goal = found[1].goal.unwrap();
        let (open, hidden) = (eye.shown(&shot(goal)).unwrap(), behind.shown(&shot(goal)).unwrap());
        assert!(open > 0.9 && hidden < 0.1, "{open}, {hidden}");
        let turned = Cone { place: [-2.9, -2.9, 0.0], ..goal };
        assert_eq!(eye.shown(&shot(turned)).unwrap(), 0.0, "out of the picture");
        // One that is asked for stands before the wall, or sticks out of it.
        let result = pairs(&world, &behind, &photograph, 4, 3).unwrap();
        let ahead = |goal: &Cone| (goal.axis() - base.position.truncate()).dot(forward.truncate());
        assert!(ahead(&goal) > 0.6 && result[0].goal.is_none());
        assert!(result[1..].iter().filter_map(|pair| pair.goal.as_ref()).all(|goal| ahead(goal) < 0.6 + goal.radius()));

        let narrow = Photograph { camera: Camera { fx: 4.0 * large.fx, ..large }, ..photograph.clone() };
        assert!(pairs(&world, &eye, &narrow, 4, 3).unwrap().is_empty(), "it shows less than the robot's camera");

        // Who says the same of both pictures agrees; who says that nothing is seen finds nothing.
        let net = Net::default();
        let mut parameters = net.draw(&mut Xoshiro256PlusPlus::new(1));
        let result = agreement(&world, &net, &parameters, &found);
        // Each picture's answers are what the counts are made of.
        let asked = questions(&world, &net, &parameters, &found);
        assert_eq!(asked.len(), result.views + result.questions);
        let seen = asked.iter().filter(|q| q.is_there && q.drawn.sure > 0.5).count();
        let imagined = asked.iter().filter(|q| !q.is_there && q.photographed.sure > 0.5).count();
        assert_eq!((seen, imagined), (result.drawn.seen, result.photographed.imagined));
        assert_eq!((result.views, result.questions), (found.len() - 1, COLOURS.len()));
        assert!((0.0..=1.0).contains(&result.p) && result.drawn.share <= 1.0);
        parameters.fill(0.0);
        let nothing = agreement(&world, &net, &parameters, &found);
        assert_eq!((nothing.drawn, nothing.p), (nothing.photographed, 1.0));
        assert_eq!((nothing.drawn.seen, nothing.drawn.bearing), (0, None));
    }
}
