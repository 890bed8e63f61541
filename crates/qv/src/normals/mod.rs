//! Normals of a capture's photographs by a model that the user has, as ONNX, through onnxruntime in a Python environment.

use crate::Failure;
use crate::capture::OpenCapture;
use crate::outcome::about;
use crate::output::{claim, keep_what_is_claimed, put, remove};
use crate::python::{Environment, said};
use clap::ValueEnum;
use serde::Deserialize;
use serde_json::json;
use std::path::Path;

const PROGRAM: &str = include_str!("normals.py");
const PYTHON: Environment = Environment {
    name: "onnx",
    packages: "onnxruntime and pillow",
    requirements: include_str!("requirements.txt"),
    import: "import onnxruntime, PIL",
    variable: "QV_ONNX_VENV",
    purpose: "onnxruntime, which runs the model of normals (30 MB)",
};
/// Where normals go, below the output folder.
const FOLDER: &str = "qv-normals";
/// Least share of normals that are turned to the camera: of what a camera sees all are.
const FACING: f64 = 0.5;

/// What a model takes colours as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Colours {
    /// 0 to 1 less the means of ImageNet, over its deviations.
    Imagenet,
    /// 0 to 1.
    Unit,
    /// 0 to 255.
    Bytes,
}

/// A model, and how it sees.
pub struct NormalModel<'a> {
    pub file: &'a Path,
    /// Which of the model's axes are x right, y down and z forward: `x,-y,-z` for one with y up and z to the viewer.
    pub axes: &'a str,
    pub colours: Colours,
}

/// Whether text names three axes, each once.
pub fn axes(text: &str) -> Result<String, String> {
    let mut letters: Vec<&str> = text.split(',').map(|axis| axis.strip_prefix('-').unwrap_or(axis)).collect();
    letters.sort_unstable();
    match letters[..] == ["x", "y", "z"] {
        true => Ok(text.to_string()),
        false => Err("expected three axes, each once, such as x,-y,-z".into()),
    }
}

#[derive(Deserialize)]
struct NormalMaps {
    facing: f64,
    pixels: u64,
}

/// Makes normals of all photographs, below `out`, and names them in the capture.
///
/// # Errors
/// A file is missing, onnxruntime cannot be had, the model is none of normals, or most of them are turned away from the camera.
pub fn add_normals(model: &NormalModel, opened: &mut OpenCapture, out: &Path) -> Result<(), Failure> {
    if !model.file.is_file() {
        return Err(about(model.file, "expected a model in ONNX, found no file"));
    }
    let folder = out.join(FOLDER);
    let written = |path: &Path, e: std::io::Error| about(path, format!("expected to write it, found {e}"));
    claim(&folder, true)?;
    let mut pairs = vec![];
    for index in 0..opened.capture.cameras.len() {
        let Some(image) = opened.capture.cameras[index].image.clone() else { continue };
        let bytes = opened.read(&image).map_err(|found| format!("image {image}: expected a file, found {found}"))?;
        let ending = Path::new(&image).extension().map_or("png".into(), |e| e.to_string_lossy().into_owned());
        let (photograph, name) =
            (folder.join(format!("{index:06}.photograph.{ending}")), format!("{FOLDER}/{index:06}.png"));
        put(&photograph, bytes).map_err(|e| written(&photograph, e))?;
        pairs.push([photograph, out.join(&name)]);
        opened.capture.cameras[index].attachments.normals = Some(name);
    }
    let colours = model.colours.to_possible_value().map_or(String::new(), |value| value.get_name().to_string());
    let axes: Vec<&str> = model.axes.split(',').collect();
    let task = folder.join("task.json");
    let text = json!({"images": pairs, "axes": axes, "colours": colours}).to_string();
    put(&task, text).map_err(|e| written(&task, e))?;
    let wrong = |found: String| about(model.file, format!("expected normals from it, found {found}"));
    let last =
        said(&PYTHON, PROGRAM, &folder.join("normals.py"), &[model.file, &task]).map_err(|e| wrong(e.to_string()))?;
    let made: NormalMaps = serde_json::from_str(&last).map_err(|_| wrong(format!("{last:?}")))?;
    if made.pixels == 0 || made.facing < FACING {
        let share = 100.0 * made.facing;
        return Err(wrong(format!("{share:.0} % turned to the camera; --normal-axes says which axes the model has")));
    }
    keep_what_is_claimed().map_err(|e| written(&folder, e))?;
    pairs.iter().for_each(|[photograph, _]| remove(photograph));
    // Not before the capture's own: its paths come first.
    opened.folders.push(out.to_path_buf());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use std::fs;

    #[test]
    fn axes_are_three_each_once() {
        assert_eq!(axes("x,-y,-z"), Ok("x,-y,-z".into()));
        assert_eq!(axes("-z,x,y"), Ok("-z,x,y".into()));
        for wrong in ["x,y", "x,x,z", "x,y,z,z", "", "--x,y,z"] {
            assert!(axes(wrong).is_err(), "{wrong}");
        }
    }

    /// A field of a protocol buffer with its length before it.
    fn field(number: u8, contents: &[u8]) -> Vec<u8> {
        assert!(contents.len() < 1 << 14);
        let length = contents.len();
        let short = [length as u8];
        let long = [(length & 0x7f) as u8 | 0x80, (length >> 7) as u8];
        [&[number << 3 | 2][..], if length < 128 { &short } else { &long }, contents].concat()
    }

    fn number(field: u8, value: u8) -> Vec<u8> {
        vec![field << 3, value]
    }

    /// A model whose normals are `normal` wherever one looks, of any size of image: nothing of it, and that added.
    fn constant_model(normal: [f32; 3]) -> Vec<u8> {
        let tensor = |name: &str, values: [f32; 3]| {
            let floats: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            let dims = [1, 3, 1, 1].map(|side| number(1, side)).concat();
            [dims, number(2, 1), field(4, &floats), field(8, name.as_bytes())].concat()
        };
        let node = |inputs: [&str; 2], output: &str, kind: &str| {
            let inputs = inputs.map(|name| field(1, name.as_bytes())).concat();
            [inputs, field(2, output.as_bytes()), field(4, kind.as_bytes())].concat()
        };
        let value = |name: &str| {
            let sides = [number(1, 1), number(1, 3), field(2, b"h"), field(2, b"w")];
            let shape = sides.map(|side| field(1, &side)).concat();
            let kind = field(1, &[number(1, 1), field(2, &shape)].concat());
            [field(1, name.as_bytes()), field(2, &kind)].concat()
        };
        let graph = [
            field(1, &node(["x", "nothing"], "dark", "Mul")),
            field(1, &node(["dark", "normal"], "y", "Add")),
            field(2, b"constant"),
            field(5, &tensor("nothing", [0.0; 3])),
            field(5, &tensor("normal", normal)),
            field(11, &value("x")),
            field(12, &value("y")),
        ]
        .concat();
        [number(1, 8), field(7, &graph), field(8, &number(2, 13))].concat()
    }

    #[test]
    #[ignore = "installs onnxruntime from the package index"]
    fn a_model_gives_normals_in_the_axes_of_the_camera() {
        use qv_splat::captures::{Capture, CaptureCamera, cameras_json};
        let folder = std::env::temp_dir().join(format!("qv-normals-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        image::RgbImage::from_pixel(50, 40, image::Rgb([9, 99, 199])).save(folder.join("a.png")).unwrap();
        let text = r#"{"format": "qv-cameras/1", "cameras": [{"image": "a.png", "width": 50, "height": 40, "fx": 60,
            "position": [0, 0, 0], "rotation": [1, 0, 0, 0]}]}"#;
        let cameras: Vec<CaptureCamera> = cameras_json::read(text).unwrap().cameras;
        let open = || OpenCapture {
            capture: Capture { cameras: cameras.clone(), ..Capture::default() },
            folders: vec![folder.clone()],
            points: None,
            is_by_colmap: false,
        };
        let file = folder.join("model.onnx");
        fs::write(&file, constant_model([1.0, 0.0, 2.0])).unwrap();
        let model = |axes| NormalModel { file: &file, axes, colours: Colours::Imagenet };
        let mut opened = open();
        add_normals(&model("x,-y,-z"), &mut opened, &folder.join("out")).unwrap();
        let name = opened.capture.cameras[0].attachments.normals.clone().unwrap();
        let normals = image::load_from_memory(&opened.read(&name).unwrap()).unwrap().into_rgb8();
        assert_eq!((normals.dimensions(), normals.get_pixel(20, 30).0), ((50, 40), [185, 128, 13]));
        let turned = add_normals(&model("x,y,z"), &mut open(), &folder.join("out")).unwrap_err().to_string();
        assert!(turned.states("0 --normal-axes"), "{turned}");
        fs::write(&file, "no model").unwrap();
        let broken = add_normals(&model("x,y,z"), &mut open(), &folder.join("out")).unwrap_err().to_string();
        assert!(broken.contains("model.onnx") && broken.states("normals"), "{broken}");
        fs::remove_dir_all(&folder).unwrap();
    }
}
