//! Prints the Go2 as URDF, for other tools: `cargo run -p quadverse-go2 --example urdf > go2.urdf`.

fn main() {
    print!("{}", qv_go2::model::urdf());
}
