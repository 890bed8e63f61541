//! `qv mesh`: a scene of Gaussians, or depth images, to a collision mesh.

mod align;
mod arguments;
mod input;
mod labels;
mod simplify;

pub use arguments::Mesh;

use crate::outcome::about;
use crate::output::{is_same, refuse_inputs, write_whole};
use crate::progress::{progress, remark, spinner};
use crate::rgbd::{self, DepthCapture};
use crate::scene::{open_cameras, open_scene};
use crate::terminal::print_message;
use crate::{Failure, Outcome, say};
use align::{Up, of_distance};
use arguments::NEIGHBOURS;
use glam::DVec3;
use input::Input;
use labels::{fitting, materials};
use qv_core::{GaussianCloud, Material, TriangleMesh};
use qv_mesh::agree::{AgreeOptions, keep_agreeing};
use qv_mesh::clean::DroppedPieces;
use qv_mesh::close::close_to_solid;
use qv_mesh::compare::{Likeness, compare_points, measurable, register, sample};
use qv_mesh::decimate::DecimateOptions;
use qv_mesh::files::{glb, ply, stl};
use qv_mesh::labels::LabelledPoints;
use qv_mesh::planes::{Laid, RenderedFrame, lay_on_planes};
use qv_mesh::similarity::Similarity;
use qv_mesh::{DepthFrame, FuseOptions, MeshOptions, MeshReport, Topology, fuse, surface};
use qv_raster::{Outputs, Scene, Settings, View, render};
use qv_splat::files::{Format, ply as splat_ply};
use qv_splat::lens::Distorter;
use qv_splat::moved;
use serde_json::json;
use simplify::{SimpleSurface, THICKNESS, simplify};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub const EXAMPLE: &str = crate::usage::help_text!(
    "Examples:\n\
     \x20 qv mesh scene.ply --cameras transforms.json --out mesh.glb\n\
     \x20 qv mesh redkitchen --up ground --triangles 50000 --out kitchen.glb --json\n\
     \x20 qv mesh yard --labels yard/labels.toml --compare yard/truth.glb --out yard.glb\n\
     \x20 qv mesh scene.ply --cameras cameras.json --up ground --out mesh.glb --scene-out upright.ply\n\
     \x20 qv mesh redkitchen --up ground --out kitchen.glb --scene-in scene.ply --scene-out upright.ply\n\
     \n\
     SCENE is a Gaussian scene (with --cameras), a folder of RGB-D frames (frame-*.depth.png in millimetres, frame-*.pose.txt,\n\
     camera-intrinsics.txt), or a capture whose transforms.json lists depth images.\n\
     Lengths are metres of the result: --markers, --trajectory and --distance are applied first.\n\
     \n\
     --labels maps features of Gaussians, or values of label images, to names and friction:\n\
     \x20 [[label]]\n\
     \x20 index = 1        # 1 + the feature's number; the value in label images\n\
     \x20 name = \"grass\"\n\
     \x20 friction = 0.6\n\
     \n\
     The mesh is a watertight solid (walls below its rim, and a floor) unless --open is given.\n\
     .glb keeps materials and friction, .ply keeps labels, .stl neither.",
    "3 done, but part of the input was lost (reported)"
);

/// Frames that must confirm a depth that was drawn.
const CONFIRMING: usize = 2;
/// Opacity of a pixel from which on its depth counts, and of a Gaussian from which on its label does.
const SOLID: f32 = 0.5;
/// Every so many pixels of a label image become a point.
const LABEL_STRIDE: usize = 3;
/// Points on each surface that is compared.
const SAMPLES: usize = 400_000;
/// Share of the points of two surfaces that meet below which laying one on the other is doubted: redkitchen from colour alone has 0.73 to 0.75, plain Gaussians 0.49.
const WELL_LAID: f64 = 0.5;

/// A scene of Gaussians without cameras: what is missing, and where it comes from.
fn cannot_mesh(scene: &Path) -> Failure {
    format!(
        "cannot mesh '{}': a Gaussian scene needs cameras to render depth from, and --cameras is missing\n\
         hint: give the cameras that it was trained with: cameras.json beside scene.ply (qv reconstruct), transforms.json (nerfstudio), or a \
         COLMAP model",
        scene.display()
    )
    .into()
}

/// A mesh that the surface is compared with.
struct Reference {
    path: PathBuf,
    /// Points spread over it.
    points: Vec<DVec3>,
    /// What it was made of, where only what that could measure counts.
    frames: Option<Vec<DepthFrame>>,
}

/// What became of depths and frame.
struct AlignedDepths {
    result_from_scene: Similarity,
    agreeing: f64,
    laid: Option<Laid>,
}

/// Writes a scene as its mesh was moved.
fn write_moved(scene: &Path, result_from_scene: &Similarity, out: &Path, format: Format) -> Result<(), Failure> {
    let file = open_scene(scene)?;
    let cloud = moved(&file.cloud, result_from_scene.scale, &result_from_scene.pose);
    let bytes = if format == Format::Ply {
        // Filters were applied when the scene was read; those of width 0 only say how it is drawn.
        let filter = file.antialias.then(|| vec![0.0; cloud.len()]);
        splat_ply::write_filtered(&cloud, file.background, filter.as_deref())
    } else {
        if file.antialias || file.background.is_some_and(|colour| colour != [0.0; 3]) {
            remark(&format!("{}: how it is drawn (background, anti-aliasing) is kept by .ply alone", out.display()));
        }
        qv_splat::files::write(&cloud, format)
    };
    write_whole(out, &bytes.map_err(|e| about(out, e))?)
}

impl Mesh {
    pub fn execute(&self) -> Result<Outcome, Failure> {
        let write = self.writer()?;
        let scene_out = self.scene_out.as_deref().map(|path| self.scene_writer(path)).transpose()?;
        let up = self.up.as_deref().map(Up::of).transpose()?;
        let distance = self.distance.as_deref().map(of_distance).transpose()?;
        let reference = self.reference()?;
        let clock = Instant::now();
        let mut input = self.read()?;
        let mut lost = std::mem::take(&mut input.capture.lost);
        let metric_from_scene = self.align(&mut input, distance)?;
        let drawn = if self.planes { input.capture.drawn() } else { vec![] };
        let agreeing = self.keep_agreeing(&mut input.capture.frames)?;
        let laid = self.planes.then(|| self.lay_on_planes(&mut input.capture.frames, &drawn)).transpose()?;
        drop(drawn);
        let read_s = clock.elapsed().as_secs_f64();

        let sign = spinner("fusing depth");
        let clock = Instant::now();
        let volume = fuse(&input.capture.frames, &self.fusing()).map_err(|e| {
            let first =
                lost.first().map_or(String::new(), |first| format!("; {} lost, the first: {first}", lost.len()));
            about(&self.scene, format!("{e}{first}"))
        })?;
        let fuse_s = clock.elapsed().as_secs_f64();
        sign.set_message("taking the surface");
        let labels = input.points.as_ref().map(|points| (points, input.materials.as_slice()));
        let options = self.options();
        let (mut mesh, mut report) = match surface(&volume, labels, &options) {
            // Nobody asked for the labels that the scene has.
            Err(error) if labels.is_some() && self.labels.is_none() => {
                lost.push(format!("labels of {}: {error}", self.scene.display()));
                surface(&volume, None, &options)
            }
            done => done,
        }
        .map_err(|e| about(&self.scene, e))?;
        drop(volume);
        self.simplify(&mut mesh, &mut report);
        let level = match up {
            Some(Up::Ground) => self.level(&input.capture.frames, &mut mesh, &mut lost)?,
            Some(Up::Along(level)) => {
                level.apply(&mut mesh);
                level
            }
            None => Similarity::IDENTITY,
        };
        let result_from_scene = level.after(&metric_from_scene);
        let likeness = reference.as_ref().map_or(Ok(vec![]), |reference| self.likeness(&mesh, reference));
        if !self.open {
            report.rims = close_to_solid(&mut mesh, THICKNESS);
            report.topology = Topology::of(&mesh);
            // Walls and floor go towards -z: ground that was seen from there is closed on the wrong side.
            if report.topology.volume < 0.0 {
                let volume = report.topology.volume;
                lost.push(format!("the solid is inside out ({volume:.3} m3): z is not up; give --up x,y,z, or --open"));
            }
        }
        let surface_s = clock.elapsed().as_secs_f64() - fuse_s;
        sign.finish_and_clear();
        write_whole(&self.out, &write(&mesh))?;
        if let Some((path, format)) = scene_out {
            write_moved(self.scene_in.as_ref().unwrap_or(&self.scene), &result_from_scene, path, format)?;
            remark(&format!("written to {}", path.display()));
        }
        // The mesh is there whatever becomes of comparing it.
        let likeness = likeness?;
        let seconds = [read_s, fuse_s, surface_s];
        let how = AlignedDepths { result_from_scene, agreeing, laid };
        self.notify(&mesh, &report, &likeness, input.capture.frames.len(), seconds, how, &lost)?;
        lost.iter().for_each(|what| print_message!("lost: {what}"));
        Ok(if lost.is_empty() { Outcome::Done } else { Outcome::Partial })
    }

    fn fusing(&self) -> FuseOptions {
        let memory_limit = (self.memory * f64::from(1 << 30)) as u64;
        FuseOptions {
            voxel: self.voxel,
            truncation: self.truncation,
            max_depth: self.max_depth,
            memory_limit,
            ..Default::default()
        }
    }

    fn options(&self) -> MeshOptions {
        MeshOptions {
            smoothing: self.smoothing,
            pieces: self.pieces,
            max_hole: self.max_hole,
            solid: None,
            // See `simplify`, which knows of walls and floor.
            triangles: None,
            ..Default::default()
        }
    }

    /// As many triangles as --triangles says, with walls and floor; says why where more are left.
    fn simplify(&self, mesh: &mut TriangleMesh, report: &mut MeshReport) {
        let Some(most) = self.triangles else { return };
        let max_error = self.max_error.unwrap_or(0.5 * self.voxel);
        let how = DecimateOptions { triangles: most, max_error };
        let SimpleSurface { mesh: simple, decimated, added } = simplify(mesh, &how, !self.open);
        (*mesh, report.decimated) = (simple, decimated);
        report.topology = Topology::of(mesh);
        let left = mesh.triangles.len() + added;
        if left > most {
            let of_which = if added > 0 { format!(", {added} of them walls and floor") } else { String::new() };
            print_message!(
                "--triangles {most}: {left} are left{of_which}: fewer would move the surface by more than {max_error} m\n\
                 hint: allow more with --max-error METRES{}",
                if added > 0 { ", or leave out walls and floor with --open" } else { "" }
            );
        }
    }

    /// What writes the file that `--out` names, known before the work begins, and its folder.
    fn writer(&self) -> Result<fn(&TriangleMesh) -> Vec<u8>, Failure> {
        self.is_own(&self.out)?;
        if let Some(folder) = self.out.parent() {
            fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
        }
        match self.out.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
            Some("glb") => Ok(glb::write),
            Some("ply") => Ok(ply::write),
            Some("stl") => Ok(stl::write),
            _ => Err(about(&self.out, "expected a file ending in .glb, .ply or .stl, found another")),
        }
    }

    /// The file of --scene-out and its format, known before the work begins, and its folder.
    fn scene_writer<'a>(&self, path: &'a Path) -> Result<(&'a Path, Format), Failure> {
        // Without cameras these are depth images, and no scene.
        let Some(scene) = self.scene_in.as_ref().or(self.cameras.as_ref().map(|_| &self.scene)) else {
            let expected = "--scene-out: expected a scene of Gaussians, or one as --scene-in, found neither";
            return Err(about(&self.scene, expected));
        };
        if !scene.exists() {
            return Err(about(scene, "expected a scene of Gaussians, found no such file"));
        }
        self.is_own(path)?;
        if path == self.out || is_same(path, &self.out) {
            return Err(about(path, "--scene-out: expected a file of its own, found that of --out"));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        fs::create_dir_all(folder).map_err(|e| about(folder, format!("expected a folder, found {e}")))?;
        let format = Format::of_name(&path.to_string_lossy());
        Ok((path, format.ok_or_else(|| about(path, "expected a file ending in .ply, .spz or .glb, found another"))?))
    }

    /// Refuses to write over what is read.
    fn is_own(&self, out: &Path) -> Result<(), Failure> {
        let others = [&self.scene_in, &self.cameras, &self.labels, &self.markers, &self.trajectory, &self.compare];
        refuse_inputs(out, others.into_iter().flatten().chain([&self.scene]))
    }

    fn read(&self) -> Result<Input, Failure> {
        let materials = self.labels.as_deref().map(materials).transpose()?;
        if self.rgbd || rgbd::holds_depth(&self.scene) {
            return self.read_depth(materials);
        }
        let expected = "expected a scene of Gaussians, or a folder with frame-*.depth.png, of TUM, Redwood or ScanNet, or transforms.json with depth_file_path";
        if self.scene.is_dir() {
            return Err(about(&self.scene, format!("{expected}, found a folder without depth")));
        }
        let file = open_scene(&self.scene)?;
        let Some(cameras) = &self.cameras else {
            return Err(cannot_mesh(&self.scene));
        };
        let labelled = file.cloud.feature_count > 1 && materials.is_some();
        let mut capture = self.draw(&file.cloud, cameras, labelled)?;
        capture.lost.extend(file.lost);
        if file.left_out > 0 {
            capture.lost.push(format!(
                "{}: {} Gaussians whose numbers are not finite",
                self.scene.display(),
                file.left_out
            ));
        }
        let labelled = file.cloud.feature_count > 0;
        let points = labelled.then(|| LabelledPoints::of_cloud(&file.cloud, SOLID)).transpose()?;
        if !labelled && materials.is_some() {
            return Err(about(
                &self.scene,
                "expected features for --labels (PLY properties feature_0, ...), found none",
            ));
        }
        let materials = fitting(materials, points.as_ref().map_or(0, |p| p.labels));
        Ok(Input { capture, points, materials })
    }

    fn read_depth(&self, materials: Option<Vec<Material>>) -> Result<Input, Failure> {
        if let Some(cameras) = &self.cameras {
            let expected = "expected a scene of Gaussians (.ply, .spz, .glb) with --cameras, found depth images";
            return Err(about(&self.scene, format!("{expected}, which have cameras: {}", cameras.display())));
        }
        let bar = progress(0, "reading depth");
        let capture = rgbd::open(&self.scene, &bar)?;
        bar.finish_and_clear();
        if capture.frames.is_empty() {
            let why = capture.lost.first().map_or(String::new(), |why| format!("; the first: {why}"));
            return Err(about(&self.scene, format!("expected depth frames, found none that can be read{why}")));
        }
        let most = capture.labels.iter().flatten().flatten().copied().max().unwrap_or(0);
        if most == 0 && materials.is_some() {
            return Err(about(&self.scene, "expected label images for --labels (label_file_path), found none"));
        }
        if most == 0 {
            return Ok(Input { capture, points: None, materials: vec![] });
        }
        let materials = fitting(materials, usize::from(most));
        let mut points = LabelledPoints::new(materials.len());
        for (index, (frame, labels)) in capture.frames.iter().zip(&capture.labels).enumerate() {
            if let Some(labels) = labels {
                points.add_image(frame, labels, LABEL_STRIDE, index)?;
            }
        }
        Ok(Input { capture, points: Some(points), materials })
    }

    /// Unbiased depth of a scene of Gaussians, from all cameras; with `labelled` only where a label is recognised: sky and passers-by are
    /// none of those that photographs were labelled with, and their depth is anything.
    fn draw(&self, cloud: &GaussianCloud, cameras: &Path, labelled: bool) -> Result<DepthCapture, Failure> {
        let mut out = DepthCapture::default();
        let outputs = Outputs { plane: true, features: labelled, ..Default::default() };
        let settings = Settings { outputs, ..Default::default() };
        let capture = open_cameras(cameras)?;
        let bar = progress(capture.cameras.len() as u64, "drawing depth");
        for one in capture.cameras {
            let lens = Distorter::new(&one.camera, &one.distortion)
                .map_err(|e| about(cameras, format!("camera {}: {e}", one.name)))?;
            let (images, _) = render(&Scene::still(cloud), &[View::of(lens.pinhole)], &settings)
                .map_err(|e| about(&self.scene, e))?;
            for image in images {
                let counts = |pixel: usize| {
                    let features = image.features.chunks_exact(cloud.feature_count.max(1)).nth(pixel);
                    image.alpha[pixel] >= SOLID && features.is_none_or(is_recognised)
                };
                let depth = (0..image.alpha.len()).map(|i| if counts(i) { image.plane_depth[i] } else { 0.0 });
                out.frames.push(DepthFrame { camera: lens.pinhole, depth: depth.collect(), weight: image.alpha });
                out.labels.push(None);
                out.colours.push(if self.planes { image.colour } else { vec![] });
            }
            out.names.push(one.name);
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(out)
    }

    /// Leaves out depths that other frames do not confirm; the share that is kept.
    fn keep_agreeing(&self, frames: &mut [DepthFrame]) -> Result<f64, Failure> {
        // Two cameras have one other frame each.
        let usual = if self.cameras.is_some() { CONFIRMING.min(frames.len().saturating_sub(1)) } else { 0 };
        let least = self.agree.unwrap_or(usual);
        let kept = keep_agreeing(
            frames,
            &AgreeOptions { least, absolute: 2.0 * self.voxel, relative: 0.01, neighbours: NEIGHBOURS },
        );
        if kept == 0.0 {
            let found = format!("none in {} frames, at voxels of {} m", frames.len(), self.voxel);
            let expected = format!("expected depth that {least} other frames confirm (--agree)");
            return Err(about(&self.scene, format!("{expected}, found {found}")));
        }
        Ok(kept)
    }

    /// Lays plain regions on planes.
    fn lay_on_planes(&self, frames: &mut [DepthFrame], drawn: &[RenderedFrame]) -> Result<Laid, Failure> {
        let sign = spinner("looking for planes");
        let laid = lay_on_planes(frames, drawn, self.voxel).map_err(|e| about(&self.scene, e))?;
        sign.finish_and_clear();
        Ok(laid)
    }

    /// What the mesh is to be compared with.
    fn reference(&self) -> Result<Option<Reference>, Failure> {
        let Some(path) = &self.compare else { return Ok(None) };
        let bytes = fs::read(path).map_err(|e| about(path, format!("expected a mesh, found {e}")))?;
        let mesh = if bytes.starts_with(b"ply") { ply::read(&bytes) } else { glb::read(&bytes) };
        let points = mesh.and_then(|mesh| sample(&mesh, SAMPLES, 2)).map_err(|e| about(path, e))?;
        let frames = self.compare_measured.as_ref().map(|folder| self.measured(folder)).transpose()?;
        Ok(Some(Reference { path: path.clone(), points, frames }))
    }

    fn likeness(&self, mesh: &TriangleMesh, reference: &Reference) -> Result<Vec<Likeness>, Failure> {
        let Reference { path, points, frames } = reference;
        let distances = [0.02, 0.05];
        let most = distances[distances.len() - 1];
        // Of what could not be measured the reference says nothing.
        let remarks = |points: Vec<DVec3>| match frames {
            Some(frames) => measurable(points, frames, most),
            None => points,
        };
        let mut found = sample(mesh, SAMPLES, 1)?;
        if self.compare_aligned {
            let laid = register(&remarks(found.clone()), points).map_err(|e| about(path, e))?;
            let (share, laid) = (laid.share, laid.reference_from_found);
            found.iter_mut().for_each(|p| *p = laid.transform_point(*p));
            let turn = laid.pose.rotation.to_axis_angle().1.to_degrees();
            let (path, scale, near) = (path.display(), laid.scale, 100.0 * share);
            print_message!(
                "laid on {path}: scale {scale:.4}, turn {turn:.2} degrees; {near:.0} % of the points of both are within 5 cm of the other then"
            );
            if share < WELL_LAID {
                print_message!(
                    "{path}: laying the mesh on it may have failed: it begins too far away or too much turned, or much is missing"
                );
            }
        }
        compare_points(&remarks(found.clone()), &found, points, &distances).map_err(|e| about(path, e))
    }

    /// RGB-D frames that a reference was made of, without what it leaves out as too far.
    fn measured(&self, folder: &Path) -> Result<Vec<DepthFrame>, Failure> {
        let bar = progress(0, "reading depth");
        let mut frames = rgbd::open(folder, &bar)?.frames;
        bar.finish_and_clear();
        let far = |depth: &f32| f64::from(*depth) > self.max_depth;
        frames.iter_mut().for_each(|frame| frame.depth.iter_mut().filter(|d| far(d)).for_each(|d| *d = 0.0));
        Ok(frames)
    }

    fn notify(
        &self,
        mesh: &TriangleMesh,
        report: &MeshReport,
        likeness: &[Likeness],
        frames: usize,
        [read_s, fuse_s, surface_s]: [f64; 3],
        AlignedDepths { result_from_scene, agreeing, laid }: AlignedDepths,
        lost: &[String],
    ) -> Result<(), Failure> {
        let topology = &report.topology;
        if self.json {
            let likeness = likeness
                .iter()
                .map(|l| json!({"distance": l.distance, "f1": l.f1(), "precision": l.precision, "recall": l.recall}));
            let line = json!({"format": "qv-mesh/1", "scene": self.scene.display().to_string(), "frames": frames,
                "out": self.out.display().to_string(), "vertices": mesh.vertices.len(), "triangles": mesh.triangles.len(),
                "extracted": report.extracted, "watertight": topology.is_watertight(), "open_edges": topology.open_edges,
                "area": topology.area, "volume": topology.volume, "holes_filled": report.holes.filled,
                "pieces_dropped": report.dropped.count, "largest_dropped": report.dropped.largest, "max_error": report.decimated.error, "blocks": report.blocks,
                "volume_bytes": report.volume_bytes, "depth_confirmed": agreeing,
                "planes": laid.as_ref().map(|laid| laid.planes.len()), "depth_on_planes": laid.as_ref().map(|laid| laid.share), "materials": areas(mesh), "likeness": likeness.collect::<Vec<_>>(),
                "result_from_scene": {"scale": result_from_scene.scale, "position": result_from_scene.pose.position.to_array(), "rotation_wxyz": result_from_scene.pose.wxyz()},
                "read_s": read_s, "fuse_s": fuse_s, "surface_s": surface_s, "lost": lost});
            return Ok(say(&format!("{line}\n"))?);
        }
        let state =
            if topology.is_watertight() { "watertight".into() } else { format!("{} open edges", topology.open_edges) };
        let mut text = format!(
            "{frames} frames, {:.0} MB of voxels; read in {read_s:.1} s, fused in {fuse_s:.1} s, surface in {surface_s:.1} s\n\
             {} triangles ({} before holes, pieces, walls and --triangles), {state}; {} holes filled, {}\n",
            report.volume_bytes as f64 / 1e6,
            mesh.triangles.len(),
            report.extracted,
            report.holes.filled,
            pieces(&report.dropped)
        );
        if agreeing < 1.0 {
            text += &format!("{:.0} % of depth confirmed by other frames\n", 100.0 * agreeing);
        }
        if let Some(laid) = laid {
            text += &format!("{:.0} % of depth lies on {} planes\n", 100.0 * laid.share, laid.planes.len());
        }
        for material in areas(mesh) {
            text += &format!(
                "  {}: {:.2} m²\n",
                material["name"].as_str().unwrap_or_default(),
                material["area"].as_f64().unwrap_or(0.0)
            );
        }
        for l in likeness {
            text += &format!(
                "F1 at {} cm: {:.3} (precision {:.3}, recall {:.3})\n",
                100.0 * l.distance,
                l.f1(),
                l.precision,
                l.recall
            );
        }
        Ok(say(&format!("{text}written to {}\n", self.out.display()))?)
    }
}

/// What was left out, and that it may be more than noise.
fn pieces(DroppedPieces { count, largest }: &DroppedPieces) -> String {
    match count {
        0 => "no pieces dropped".into(),
        _ => format!("{count} pieces dropped, the largest of {largest:.2} m² (--open --pieces AREA keeps more)"),
    }
}

/// Name, friction and area \[m²\] of each material.
fn areas(mesh: &TriangleMesh) -> Vec<serde_json::Value> {
    let mut areas = vec![0.0; mesh.materials.len()];
    for (t, label) in mesh.labels.iter().enumerate() {
        let [a, b, c] = mesh.corners(t);
        areas[usize::from(*label)] += 0.5 * (b - a).cross(c - a).length();
    }
    let of = |(material, area): (&Material, f64)| json!({"name": material.name, "friction": material.friction, "area": area});
    mesh.materials.iter().zip(areas).map(of).collect()
}

/// Whether one of the labels is at least as likely as all others together, for features that are logits (as `qv reconstruct` learns them).
/// Of one label or two one always is: where two meet, what is drawn is as undecided as the sky.
fn is_recognised(features: &[f32]) -> bool {
    let most = features.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let sum: f32 = features.iter().map(|x| (x - most).exp()).sum();
    sum <= 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn what_no_label_of_three_stands_out_of_is_not_recognised() {
        assert!(!is_recognised(&[0.0; 3]) && !is_recognised(&[0.3, 0.0, 0.1]));
        assert!(is_recognised(&[0.0, 0.0, 2.0]) && is_recognised(&[0.0; 2]) && is_recognised(&[0.0]));
    }

    #[test]
    fn up_and_distances_are_read_before_the_work() {
        assert!(matches!(Up::of("ground"), Ok(Up::Ground)) && matches!(Up::of("0, -1,0"), Ok(Up::Along(_))));
        for bad in ["foo", "nan,0,1", "0,0,0", "1,2"] {
            let error = Up::of(bad).err().unwrap().to_string();
            assert!(error.starts_with("--up: ") && error.contains("expected"), "{error}");
        }
        assert!(of_distance(&[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0]).is_ok());
        assert!(of_distance(&[1.0]).unwrap_err().to_string().states("numbers 1"));
    }
}
