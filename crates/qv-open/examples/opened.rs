//! Opens a recording and its robot, and says what they are: `cargo run -p quadverse-open --example opened -- walk.mcap`.

use qv_open::{Reading, model_of, open_run, remarks_of};
use qv_recording::RecordingError;
use std::path::Path;

fn main() -> Result<(), RecordingError> {
    let Some(name) = std::env::args().nth(1) else {
        println!("expected a recording, such as walk.mcap");
        return Ok(());
    };
    let path = Path::new(&name);
    let run = open_run(path, &Reading::default(), &|_, _| {})?;
    let [from, to] = run.span();
    println!("{} joints, {:.1} s", run.joints(), to - from);
    let model = model_of(&run, path, None)?;
    println!("{} of {:.2} kg", model.name, model.mass());
    remarks_of(&run, &model).iter().for_each(|line| println!("{line}"));
    Ok(())
}
