//! The golden of a short training, for `cargo xtask golden bless short`: `short_training OUT.json`.

#[path = "../tests/it/short/mod.rs"]
mod short;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::args().nth(1).ok_or("expected the name of a file for the golden, found none")?;
    let trained = short::train(&short::settings(), short::ITERATIONS);
    println!("untrained {:?}\ntrained {:?}", trained.untrained, trained.score);
    let golden = short::Golden::new(trained.figures);
    std::fs::write(out, serde_json::to_string_pretty(&golden)? + "\n")?;
    Ok(())
}
