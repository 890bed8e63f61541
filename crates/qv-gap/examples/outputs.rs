//! Writes all files of a diagnosis (made up, of a robot with slow motors on a floor with a slick patch) to a folder:
//! `cargo run -p quadverse-gap --example outputs -- FOLDER`.

#[path = "../tests/it/made_up/mod.rs"]
mod made_up;

fn main() -> std::io::Result<()> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "target/outputs".into()));
    std::fs::create_dir_all(&folder)?;
    let (model, urdf) = (made_up::go2(), qv_go2::model::urdf());
    let (kp, kd) = ([qv_go2::model::DEFAULT_KP; 12], [qv_go2::model::DEFAULT_KD; 12]);
    let notes = ["This diagnosis is made up.".to_string()];
    let files = qv_gap::export::files(
        &made_up::report(),
        &model,
        Some(&urdf),
        "made_up.mcap",
        &notes,
        &[],
        qv_gap::export::Gains { kp: &kp, kd: &kd },
    );
    for (name, bytes) in files {
        std::fs::write(folder.join(&name), &bytes)?;
        println!("{name} {} bytes", bytes.len());
    }
    Ok(())
}
