//! Poses and lenses of a capture found again by COLMAP, in the frame and the metres of the poses that the capture has.
//!
//! Poses that a depth camera or a robot measured are good to centimetres and a degree, which is too little for what photographs show:
//! depth from photographs a decimetre or three apart needs a few hundredths of a degree. Whether they are good enough is seen by the matches
//! between photographs that COLMAP verifies without any poses: good poses explain nearly all of them.

use super::{CameraHints, ColmapResult, GivenCamera, find, is_there};
use crate::Failure;
use crate::capture::{OpenCapture, open_capture};
use crate::outcome::about;
use crate::output::{self, make_folder, put, write_whole};
use glam::DVec3;
use qv_mesh::similarity::Similarity;
use qv_splat::captures::{CaptureCamera, pictures};
use qv_splat::train::cameras::same_lens;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

/// File that says what the poses were found of.
const STAMP: &str = "poses.json";
/// Largest part of the fewest photographs that must have a pose.
const FEWEST: usize = 8;

/// COLMAP's poses are taken where the given ones explain less than this share of the matches that COLMAP's explain.
const AS_GOOD: f64 = 0.9;

/// What poses were found of, so that they are not looked for twice.
#[derive(Serialize, Deserialize)]
struct Stamp {
    contents: u64,
    placed: ColmapResult,
}

/// A capture with the poses that were chosen for it.
pub struct PoseChoice {
    pub opened: OpenCapture,
    /// What was lost, a line each.
    pub lost: Vec<String>,
    /// How COLMAP's poses are; null where those of the capture stay.
    pub found: Value,
    /// Whose poses were taken, and why, in words.
    pub why: String,
    /// Shares of the verified matches that the given poses and COLMAP's explain, where that is known.
    pub explain: [Option<f64>; 2],
}

impl PoseChoice {
    /// The capture as it is.
    pub fn given(opened: OpenCapture, why: impl Into<String>) -> Self {
        Self { opened, lost: vec![], found: Value::Null, why: why.into(), explain: [None; 2] }
    }

    pub fn is_given(&self) -> bool {
        self.found.is_null()
    }
}

/// The capture with poses, lenses and points by COLMAP.
///
/// # Errors
/// A photograph is missing, COLMAP cannot be had or fails, fewer than 8 photographs find a place, or their given places are on one line.
pub fn poses_again(path: &Path, opened: OpenCapture, folder: &Path) -> Result<PoseChoice, Failure> {
    let placed = placed_again(path, &opened, folder, false)?;
    with_found(path, opened, folder, &placed, "they were asked for".into())
}

/// The capture with its own poses, or with COLMAP's where those explain the verified matches better and COLMAP is there already.
///
/// # Errors
/// A photograph is missing. Where COLMAP fails the given poses stay, and why is reported.
pub fn better_poses(path: &Path, opened: OpenCapture, folder: &Path) -> Result<PoseChoice, Failure> {
    let photographs = opened.capture.cameras.iter().filter(|one| one.image.is_some()).count();
    if opened.is_by_colmap || photographs < FEWEST {
        let why = if opened.is_by_colmap { "COLMAP found them" } else { "there are too few images to check them" };
        return Ok(PoseChoice::given(opened, why));
    }
    if !is_there() {
        return Ok(PoseChoice::given(opened, UNCHECKED));
    }
    let is_turned = |one: &CaptureCamera| {
        one.image.as_ref().is_some_and(|image| opened.read(image).is_ok_and(|bytes| pictures::is_turned(&bytes)))
    };
    if opened.capture.cameras.iter().any(is_turned) {
        return Ok(PoseChoice::given(opened, "EXIF rotates images, and COLMAP ignores it"));
    }
    let placed = match placed_again(path, &opened, folder, true) {
        Ok(placed) => placed,
        Err(error) => return Ok(PoseChoice::given(opened, format!("COLMAP could not check them: {error}"))),
    };
    let explain = [placed.given_explain, placed.found_explain];
    match choice(&placed) {
        Choice::Given(why) => {
            // What was found is remembered; copies of the photographs are of no more use.
            output::clear(&folder.join("images")).map_err(|e| about(folder, e))?;
            output::remove(&folder.join("database.db"));
            Ok(PoseChoice { explain, ..PoseChoice::given(opened, why) })
        }
        Choice::Found(why) => with_found(path, opened, folder, &placed, why),
    }
}

/// Why given poses stay where COLMAP is not there.
pub const UNCHECKED: &str =
    "COLMAP, which could check them, is not there; --poses colmap fetches it (50 MB, once) and takes its poses";

/// Whose poses explain the matches.
#[derive(Debug, PartialEq)]
enum Choice {
    Given(String),
    Found(String),
}

fn choice(placed: &ColmapResult) -> Choice {
    let Some(given) = placed.given_explain else {
        return Choice::Given("COLMAP said nothing of them".into());
    };
    let in_words = |share: f64| format!("{:.0} %", 100.0 * share);
    let Some(found) = placed.found_explain.filter(|_| placed.placed >= FEWEST.min(placed.frames)) else {
        return Choice::Given(format!("they explain {} of the verified matches", in_words(given)));
    };
    let both = format!("{} of the verified matches, those by COLMAP {}", in_words(given), in_words(found));
    match given < AS_GOOD * found {
        true => Choice::Found(format!("those of the capture explain {both}")),
        false => Choice::Given(format!("they explain {both}")),
    }
}

/// What COLMAP makes of the photographs, or made of the same ones before. With `check` no model is made where the given poses are good.
fn placed_again(path: &Path, opened: &OpenCapture, folder: &Path, check: bool) -> Result<ColmapResult, Failure> {
    output::claim(folder, false)?;
    let (mut given, contents) = copied(path, opened, &folder.join("images"))?;
    given.check = check;
    let stamp = folder.join(STAMP);
    let known = fs::read_to_string(&stamp).ok().and_then(|text| serde_json::from_str::<Stamp>(&text).ok());
    let is_enough = |known: &Stamp| {
        let has_model = known.placed.placed > 0 && folder.join("sparse/0/images.bin").is_file();
        known.contents == contents && (has_model || check && known.placed.given_explain.is_some())
    };
    let cannot = |e: std::io::Error| about(folder, e);
    if let Some(known) = known.filter(is_enough) {
        output::keep_what_is_claimed().map_err(cannot)?;
        return Ok(known.placed);
    }
    let placed = find(&folder.join("images"), folder, Some(&given))?;
    let text = serde_json::to_string(&Stamp { contents, placed: placed.clone() })?;
    write_whole(&stamp, text.as_bytes())?;
    output::commit().and_then(|()| output::keep_what_is_claimed()).map_err(cannot)?;
    Ok(placed)
}

fn with_found(
    path: &Path,
    mut opened: OpenCapture,
    folder: &Path,
    placed: &ColmapResult,
    why: String,
) -> Result<PoseChoice, Failure> {
    if placed.placed < FEWEST.min(placed.frames) {
        let expected = format!("expected places of at least {FEWEST} images by COLMAP");
        return Err(about(path, format!("{expected}, found {} of {}", placed.placed, placed.frames)));
    }
    let found = adopted(&mut opened, open_capture(folder)?, placed).map_err(|e| about(path, e))?;
    let mut lost = vec![];
    if placed.placed < placed.frames {
        let without = placed.frames - placed.placed;
        lost.push(format!("{}: {without} of {} images find no place", path.display(), placed.frames));
    }
    lost.extend(placed.doubt(path));
    Ok(PoseChoice { opened, lost, found, why, explain: [placed.given_explain, placed.found_explain] })
}

/// Copies photographs, a folder for each lens, and shows what the files hold.
fn copied(path: &Path, opened: &OpenCapture, folder: &Path) -> Result<(CameraHints, u64), Failure> {
    output::clear(folder).map_err(|e| about(folder, e))?;
    let mut given = CameraHints { cameras: vec![], poses: BTreeMap::new(), check: false };
    let mut lenses: Vec<&CaptureCamera> = vec![];
    let mut hasher = DefaultHasher::new();
    for (index, one) in opened.capture.cameras.iter().enumerate() {
        let Some(image) = &one.image else { continue };
        let bytes = opened
            .read(image)
            .map_err(|found| about(path, format!("image {image}: expected a file, found {found}")))?;
        let same = |lens: &&CaptureCamera| same_lens(&lens.camera, &one.camera) && lens.distortion == one.distortion;
        let group = lenses.iter().position(same).unwrap_or_else(|| {
            lenses.push(one);
            given.cameras.push(of_lens(one));
            lenses.len() - 1
        });
        let ending = Path::new(image).extension().map_or("png".into(), |e| e.to_string_lossy().to_lowercase());
        let name = format!("{group}/{index:06}.{ending}");
        let file = folder.join(&name);
        let written = make_folder(&folder.join(group.to_string())).and_then(|()| put(&file, &bytes));
        written.map_err(|e| about(&file, format!("expected to write it, found {e}")))?;
        bytes.hash(&mut hasher);
        let pose = one.camera.camera_from_world;
        let (turn, at) = (pose.matrix(), pose.position.to_array());
        let row = |k: usize| turn.row(k).to_array().into_iter().chain([at[k]]);
        given.poses.insert(name.clone(), (0..3).flat_map(row).collect());
        given.cameras[group].images.push(name);
    }
    serde_json::to_string(&given)?.hash(&mut hasher);
    output::commit().map_err(|e| about(folder, e))?;
    Ok((given, hasher.finish()))
}

/// A lens as COLMAP has it, to begin with.
fn of_lens(one: &CaptureCamera) -> GivenCamera {
    let (c, d) = (&one.camera, &one.distortion);
    let square = (c.fx - c.fy).abs() < 1e-3 * c.fx;
    let (model, params) = if d.is_none() && square {
        ("SIMPLE_RADIAL", vec![c.fx, c.cx, c.cy, 0.0])
    } else {
        ("OPENCV", vec![c.fx, c.fy, c.cx, c.cy, d.k1, d.k2, d.p1, d.p2])
    };
    GivenCamera { model: model.into(), params, images: vec![] }
}

/// Puts what was found in the place of what was given, moved to where the given poses are.
fn adopted(opened: &mut OpenCapture, found: OpenCapture, placed: &ColmapResult) -> Result<Value, String> {
    let index = |one: &CaptureCamera| one.name.rsplit('/').next().and_then(|name| name.parse::<usize>().ok());
    let by_index: BTreeMap<usize, CaptureCamera> =
        found.capture.cameras.into_iter().filter_map(|one| Some((index(&one)?, one))).collect();
    let place = |one: &CaptureCamera| one.camera.camera_from_world.inverse().position;
    let (from, to): (Vec<DVec3>, Vec<DVec3>) = (by_index.iter())
        .filter_map(|(index, one)| Some((place(one), place(opened.capture.cameras.get(*index)?))))
        .unzip();
    let (given_from_found, left) = Similarity::from_points(&from, &to)
        .map_err(|e| format!("places of cameras, to bring COLMAP's poses to where they were: {e}"))?;
    let mut turned = 0.0;
    let mut kept = vec![];
    for (index, mut one) in std::mem::take(&mut opened.capture.cameras).into_iter().enumerate() {
        let Some(again) = by_index.get(&index) else { continue };
        let given = one.camera.camera_from_world;
        one.camera = again.camera;
        one.distortion = again.distortion;
        one.camera.camera_from_world = given_from_found.of_camera(&again.camera.camera_from_world);
        turned += one.camera.camera_from_world.rotation.angle_between(given.rotation).powi(2);
        kept.push(one);
    }
    let turned = (turned / kept.len().max(1) as f64).sqrt().to_degrees();
    opened.capture.cameras = kept;
    opened.points = found.points.map(|mut points| {
        for place in &mut points.places {
            let moved = given_from_found.transform_point(DVec3::from_array(place.map(f64::from)));
            *place = moved.to_array().map(|x| x as f32);
        }
        points
    });
    Ok(
        json!({"placed": placed.placed, "of": placed.frames, "held": placed.held, "from_given_m": left, "from_given_deg": turned}),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use qv_core::{Camera, Pose};
    use qv_splat::captures::distortion::Distortion;
    use qv_splat::captures::{Attachments, Capture};
    use qv_splat::files::Points;

    fn one(name: &str, at: f64, width: u32) -> CaptureCamera {
        let camera_from_world =
            Pose::from_xyz_rpy([at.cos(), at.sin(), 0.2 * at], [0.1 * at, 0.2, -0.3 * at]).inverse();
        let camera = Camera { fx: 50.0, fy: 50.0, cx: 30.0, cy: 20.0, width, height: 40, camera_from_world };
        let image = Some(format!("{name}.png"));
        CaptureCamera {
            name: name.into(),
            camera,
            distortion: Distortion::default(),
            image,
            attachments: Attachments::default(),
        }
    }

    fn open(cameras: Vec<CaptureCamera>) -> OpenCapture {
        OpenCapture {
            origin: None,
            capture: Capture { cameras, ..Capture::default() },
            folders: vec![],
            points: None,
            is_by_colmap: false,
        }
    }

    fn placed(frames: usize, placed: usize, given: Option<f64>, found: Option<f64>) -> ColmapResult {
        ColmapResult { frames, placed, held: 0.9, given_explain: given, found_explain: found }
    }

    #[test]
    fn poses_are_taken_from_colmap_only_where_they_explain_clearly_more() {
        let of = |p: ColmapResult| choice(&p);
        let is_found = |p: ColmapResult| matches!(of(p), Choice::Found(_));
        assert!(is_found(placed(50, 50, Some(0.50), Some(0.95))));
        assert!(is_found(placed(50, 40, Some(0.80), Some(0.90))));
        // A good pose stays, and so does one that is as good as what was found.
        assert!(!is_found(placed(50, 0, Some(0.97), None)));
        assert!(!is_found(placed(50, 50, Some(0.85), Some(0.93))));
        // A model of few photographs says nothing of the others.
        assert!(!is_found(placed(50, 5, Some(0.30), Some(0.95))));
        let why = of(placed(50, 50, Some(0.503), Some(0.952)));
        let remarks = "those of the capture explain 50 % of the verified matches, those by COLMAP 95 %";
        assert_eq!(why, Choice::Found(remarks.into()));
    }

    #[test]
    fn what_was_found_comes_to_where_the_given_poses_are() {
        let names = ["a", "b", "c", "d"];
        let mut given = open(names.iter().enumerate().map(|(k, name)| one(name, k as f64, 60)).collect());
        // The same cameras in a frame of other scale, turned; of the third nothing is known.
        let found_from_given = Similarity { scale: 0.4, pose: Pose::from_xyz_rpy([3.0, -1.0, 2.0], [0.5, -0.4, 1.0]) };
        let again = |k: usize| {
            let mut one = one(&format!("0/{k:06}"), k as f64, 60);
            one.camera.fx = 51.0;
            one.camera.camera_from_world = found_from_given.of_camera(&one.camera.camera_from_world);
            one
        };
        let mut found = open([0, 1, 3].map(again).to_vec());
        let point = DVec3::new(0.3, 0.2, 0.1);
        let place = found_from_given.transform_point(point).to_array().map(|x| x as f32);
        found.points = Some(Points { places: vec![place], colours: vec![[0.5; 3]], ..Default::default() });
        let wanted: Vec<Pose> = [0, 1, 3].map(|k| given.capture.cameras[k].camera.camera_from_world).to_vec();
        let remarks = adopted(&mut given, found, &placed(4, 3, None, None)).unwrap();
        let cameras = &given.capture.cameras;
        assert_eq!(cameras.iter().map(|one| &*one.name).collect::<Vec<_>>(), ["a", "b", "d"]);
        for (camera, wanted) in cameras.iter().zip(&wanted) {
            let pose = &camera.camera.camera_from_world;
            assert!(
                pose.position.distance(wanted.position) < 1e-9 && pose.rotation.angle_between(wanted.rotation) < 1e-7
            );
            assert_eq!((camera.camera.fx, camera.image.is_some()), (51.0, true));
        }
        let place = given.points.unwrap().places[0];
        assert!(DVec3::from_array(place.map(f64::from)).distance(point) < 1e-6, "{place:?}");
        assert!(
            remarks["from_given_m"].as_f64().unwrap() < 1e-9 && remarks["from_given_deg"].as_f64().unwrap() < 1e-5,
            "{remarks}"
        );
    }

    #[test]
    fn photographs_are_copied_by_lens_and_what_is_missing_is_named() {
        let folder = std::env::temp_dir().join(format!("qv-again-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        for name in ["a.png", "b.png", "c.png"] {
            fs::write(folder.join(name), name).unwrap();
        }
        let mut opened = open(vec![one("a", 0.0, 60), one("b", 1.0, 64), one("c", 2.0, 60)]);
        opened.folders = vec![folder.clone()];
        let (given, contents) = copied(Path::new("x"), &opened, &folder.join("images")).unwrap();
        let images: Vec<&[String]> = given.cameras.iter().map(|camera| &camera.images[..]).collect();
        assert_eq!(images, [&["0/000000.png".to_string(), "0/000002.png".into()][..], &["1/000001.png".into()]]);
        assert_eq!(fs::read(folder.join("images/1/000001.png")).unwrap(), b"b.png");
        assert_eq!(copied(Path::new("x"), &opened, &folder.join("images")).unwrap().1, contents);
        fs::write(folder.join("b.png"), "other").unwrap();
        assert_ne!(copied(Path::new("x"), &opened, &folder.join("images")).unwrap().1, contents);
        fs::remove_file(folder.join("b.png")).unwrap();
        let error = copied(Path::new("x"), &opened, &folder.join("images")).unwrap_err().to_string();
        assert!(error.states("b.png"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
