//! A robot without a recording: one that is built in, a file, or the text itself.

use crate::error::file_error;
use crate::mesh_file::read_mesh;
use crate::model::{read_model, read_urdf, walking_robot};
use qv_recording::RecordingError;
use qv_sim::{BaseKind, Model, ModelOptions};
use std::path::Path;

/// The model of `robot`: `go2` (all shapes collide), a URDF or MJCF file (meshes are looked for beside it), or the text of one, which begins with `<`.
///
/// # Errors
/// There is no such file, or it holds no robot.
pub fn robot_model(robot: &str, base: BaseKind) -> Result<Model, RecordingError> {
    let is_text = robot.trim_start().starts_with('<');
    let path = if is_text { Path::new("robot.urdf") } else { Path::new(robot) };
    let (text, armature, remarks) = match robot {
        "go2" => (qv_go2::model::urdf_with_shapes(), qv_go2::model::ARMATURE, None),
        text if is_text => (text.to_owned(), 0.0, None),
        name => match walking_robot(name) {
            Some(found) => (found.text, found.armature, None),
            None => {
                let (text, remarks) =
                    read_urdf(path, "go2, go1, a1, a2, anymal_c, a URDF or MJCF file, or the text of one")?;
                (text, 0.0, remarks)
            }
        },
    };
    let beside = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let beside = beside.canonicalize().unwrap_or_else(|_| beside.to_path_buf());
    let meshes = |mesh: &str| read_mesh(&beside, mesh);
    let options = ModelOptions { base, armature, mesh_reader: Some(&meshes), held: &[] };
    let mut model = read_model(&text, &beside, &options).map_err(|e| file_error(path, "a robot", &e.to_string()))?;
    model.remarks.extend(remarks);
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_is_a_name_a_file_or_a_text() {
        let go2 = robot_model("go2", BaseKind::Floating).unwrap();
        assert_eq!((go2.joints.len(), go2.nq()), (12, 19));
        let a2 = robot_model("a2", BaseKind::Floating).unwrap();
        assert!(a2.mass() > 25.0 && a2.joints.len() == 12, "{} kg", a2.mass());
        let text = qv_go2::model::urdf();
        assert_eq!(robot_model(&text, BaseKind::Fixed).unwrap().nq(), 12);
        let file = std::env::temp_dir().join(format!("qv-robot-{}.urdf", std::process::id()));
        std::fs::write(&file, text).unwrap();
        assert_eq!(robot_model(file.to_str().unwrap(), BaseKind::Floating).unwrap().nv(), 18);
        std::fs::remove_file(file).unwrap();
        let error = robot_model("nowhere.urdf", BaseKind::Fixed).unwrap_err().to_string();
        assert!(error.contains("nowhere.urdf") && error.contains("go2"), "{error}");
    }
}
