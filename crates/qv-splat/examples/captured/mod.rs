//! Captures as the examples open them: a folder with `transforms.json`, or of RGB-D frames as 7-Scenes has them.

use qv_splat::captures::{Capture, nerfstudio, rgbd};
use qv_splat::error_at;
use std::error::Error;
use std::fs;
use std::path::Path;

/// Reads what a folder says of its photographs; they themselves are not read.
pub fn capture(folder: &Path) -> Result<Capture, Box<dyn Error>> {
    let file = folder.join("transforms.json");
    if file.is_file() {
        return Ok(nerfstudio::read(&fs::read_to_string(&file)?)?);
    }
    let names = fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let names = names.collect::<Result<Vec<_>, std::io::Error>>()?;
    Ok(rgbd::read(&names, &mut |name| {
        fs::read_to_string(folder.join(name)).map_err(|e| error_at(name, "a text", &e.to_string()))
    })?)
}
