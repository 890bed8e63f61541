//! Poses and lenses of a capture found again by COLMAP, in the frame and the metres of the poses that the capture has.
//!
//! Poses that a depth camera or a robot measured are good to centimetres and a degree, which is too little for what photographs show:
//! depth from photographs a decimetre or three apart needs a few hundredths of a degree.

use super::{Given, GivenCamera, Placed, find};
use crate::Failure;
use crate::capture::{OpenCapture, open_capture};
use crate::scene::about;
use crate::whole::{put, write_whole};
use glam::DVec3;
use qv_mesh::similarity::Similarity;
use qv_splat::captures::CaptureCamera;
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

/// What poses were found of, so that they are not looked for twice.
#[derive(Serialize, Deserialize)]
struct Stamp {
    contents: u64,
    placed: Placed,
}

/// The capture with poses, lenses and points by COLMAP; what was lost; and how far they are from the given ones.
///
/// # Errors
/// A photograph is missing, COLMAP cannot be had or fails, fewer than 8 photographs find a place, or their given places are on one line.
pub fn poses_again(
    path: &Path,
    mut opened: OpenCapture,
    folder: &Path,
) -> Result<(OpenCapture, Vec<String>, Value), Failure> {
    let (given, contents) = copied(path, &opened, &folder.join("images"))?;
    let stamp = folder.join(STAMP);
    let known = fs::read_to_string(&stamp).ok().and_then(|text| serde_json::from_str::<Stamp>(&text).ok());
    let placed = match known.filter(|known| known.contents == contents && folder.join("sparse/0/images.bin").is_file())
    {
        Some(known) => known.placed,
        None => {
            let placed = find(&folder.join("images"), folder, Some(&given))?;
            let text = serde_json::to_string(&Stamp { contents, placed: placed.clone() })?;
            write_whole(&stamp, text.as_bytes())?;
            placed
        }
    };
    if placed.placed < FEWEST.min(placed.frames) {
        let expected = format!("expected places of at least {FEWEST} photographs by COLMAP");
        return Err(about(path, format!("{expected}, found {} of {}", placed.placed, placed.frames)));
    }
    let found = open_capture(folder)?;
    let told = adopted(&mut opened, found, &placed).map_err(|e| about(path, e))?;
    let mut lost = vec![];
    if placed.placed < placed.frames {
        let without = placed.frames - placed.placed;
        lost.push(format!("{}: {without} of {} photographs find no place", path.display(), placed.frames));
    }
    lost.extend(placed.doubt(path));
    Ok((opened, lost, told))
}

/// Copies photographs, a folder for each lens, and tells what the files hold.
fn copied(path: &Path, opened: &OpenCapture, folder: &Path) -> Result<(Given, u64), Failure> {
    fs::remove_dir_all(folder).ok();
    let mut given = Given { cameras: vec![] };
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
        let written = fs::create_dir_all(folder.join(group.to_string())).and_then(|()| put(&file, &bytes));
        written.map_err(|e| about(&file, format!("expected to write it, found {e}")))?;
        bytes.hash(&mut hasher);
        given.cameras[group].images.push(name);
    }
    serde_json::to_string(&given)?.hash(&mut hasher);
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
fn adopted(opened: &mut OpenCapture, found: OpenCapture, placed: &Placed) -> Result<Value, String> {
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
        OpenCapture { capture: Capture { cameras, ..Capture::default() }, folders: vec![], points: None }
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
        let told = adopted(&mut given, found, &Placed { frames: 4, placed: 3, held: 0.9 }).unwrap();
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
            told["from_given_m"].as_f64().unwrap() < 1e-9 && told["from_given_deg"].as_f64().unwrap() < 1e-5,
            "{told}"
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
        assert!(error.contains("image b.png: expected a file"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
