//! Mistakes that users make: typing errors, missing files, files of the wrong kind. Each ends in `error: cannot VERB 'OBJECT': REASON` and a hint.

use crate::bags::{directory, small_chunks, walk, write};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// A folder with a recording and files of wrong kinds.
fn files() -> std::path::PathBuf {
    let folder = directory("mistakes");
    let put = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).unwrap();
    put("walk.mcap", &write(&walk(1.0), small_chunks(None), &[]));
    put("notes.txt", b"what I did today\n");
    put("empty.mcap", b"");
    put("empty.ply", b"");
    put("broken.json", b"{\"format\": ");
    put("other.json", b"{}");
    put("run.csv", b"time,position.a\n0,0\n");
    put("photo.png", b"\x89PNG\r\n\x1a\n");
    put("params.toml", b"parameters = \n");
    put("robot.urdf", b"<robot name='r'>");
    put("policy.onnx", b"no policy");
    fs::create_dir_all(folder.join("nothing")).unwrap();
    folder
}

/// Words of a command, what its error begins with, and a word of its hint.
const MISTAKES: [(&str, &str, &str); 51] = [
    ("inspect gone.mcap", "open 'gone.mcap': no such file", "recording"),
    ("inspect wlak.mcap", "open 'wlak.mcap': no such file", "did you mean 'walk.mcap'"),
    ("inspect notes.txt", "read 'notes.txt': ", ""),
    ("inspect empty.mcap", "", ""),
    ("inspect nothing", "read 'nothing': ", ""),
    ("inspect run.csv", "open 'run.toml': no such file", "run description"),
    ("inspect photo.png", "read 'photo.png': ", ""),
    ("replay gone.mcap --out o", "open 'gone.mcap': no such file", ""),
    ("replay walk.mcap --robot gone.urdf --out o", "open 'gone.urdf': no such file", "robot"),
    ("replay walk.mcap --robot robot.urd --out o", "open 'robot.urd': no such file", "did you mean 'robot.urdf'"),
    ("replay walk.mcap --robot goo2 --out o", "", ""),
    ("replay walk.mcap --robot robot.urdf --out o", "", ""),
    ("replay walk.mcap --robot notes.txt --out o", "", ""),
    ("replay walk.mcap --terrain gone.glb --out o", "open 'gone.glb': no such file", ""),
    ("replay walk.mcap --terrain notes.txt --out o", "", ""),
    ("replay walk.mcap --params gone.toml --out o", "open 'gone.toml': no such file", ""),
    ("replay walk.mcap --params params.toml --out o", "read 'params.toml': ", ""),
    ("replay walk.mcap --namespace rex --out o", "", ""),
    ("diagnose gone.mcap --out o", "open 'gone.mcap': no such file", ""),
    ("diagnose walk.mcap --without frictoin --out o", "use '--without': unknown effect", "did you mean"),
    ("diagnose walk.mcap --library gone.toml --out o", "open 'gone.toml': no such file", "library"),
    ("diagnose walk.mcap --library params.toml --out o", "read 'params.toml': ", ""),
    ("diagnose walk.mcap --reference gone.mcap --out o", "open 'gone.mcap': no such file", ""),
    ("diagnose walk.mcap --ground-error 3 --out o", "use '--ground-error': ", ""),
    ("contact walk.mcap --terrain gone.glb --out o", "open 'gone.glb': no such file", ""),
    ("contact walk.mcap --terrain notes.txt --out o", "", ""),
    ("mesh gone.ply --cameras other.json --out m.glb", "", ""),
    ("mesh empty.ply --cameras other.json --out m.glb", "read 'empty.ply': ", ""),
    ("mesh empty.ply --out m.obj", "", ""),
    ("mesh empty.ply --up north --out m.glb", "use '--up': ", ""),
    ("mesh nothing --out m.glb", "read 'nothing': ", ""),
    ("render gone.ply --cameras other.json --out o", "open 'gone.ply': no such file", ""),
    ("render empty.ply --cameras other.json --out o", "read 'empty.ply': ", ""),
    ("reconstruct gone --out o", "", ""),
    ("reconstruct notes.txt --out o", "", ""),
    ("reconstruct nothing --out o", "", ""),
    ("view gone --out v.html", "", ""),
    ("view nothing --out v.html", "", ""),
    ("report --evidence gone.json --out r.html", "open 'gone.json': no such file", "evidence"),
    ("report --evidence broken.json --out r.html", "", ""),
    ("report --diagnosis other.json --out r.html", "open 'other.json/report.json': ", "expected a report"),
    ("next walk.mcap --diagnosis gone --out o", "", ""),
    ("drift walk.mcap --baseline gone", "", ""),
    ("fleet run gone", "", ""),
    ("fleet gather gone", "", ""),
    ("fleet plan gone --out o", "", ""),
    ("check gone.mcap", "", ""),
    ("params goo2", "", ""),
    ("walk score gone.onnx", "", ""),
    ("walk score policy.onnx", "", ""),
    ("walk describe nobody", "", ""),
];

fn said(folder: &Path, words: &str) -> (i32, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_qv"));
    command.current_dir(folder).args(words.split(' ')).args(["--quiet", "--no-config"]).stdin(Stdio::null());
    let output = command.output().unwrap();
    (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn mistakes_have_an_error_of_one_shape_and_a_hint() {
    let folder = files();
    let mut wrong = Vec::new();
    for (words, begins, hint) in MISTAKES {
        let (code, err) = said(&folder, words);
        let mut lines = err.lines().skip_while(|line| !line.starts_with("error: "));
        let (error, hinted) = (lines.next().unwrap_or_default(), lines.next().unwrap_or_default());
        let mut parts = error.strip_prefix("error: cannot ").unwrap_or_default().splitn(2, ' ');
        let (verb, rest) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
        let is_verb = !verb.is_empty() && verb.chars().all(|c| c.is_ascii_lowercase());
        let has_object = rest.starts_with('\'') && rest.contains("': ");
        let is_hint = hinted.starts_with("hint: ") && hinted.contains(hint) && lines.next().is_none();
        let begins = error.starts_with(&format!("error: cannot {begins}"));
        if !(code == 1 && is_verb && has_object && is_hint && begins && !error.contains("os error")) {
            wrong.push(format!("qv {words} ({code})\n{err}"));
        }
    }
    assert!(wrong.is_empty(), "{} of {}\n{}", wrong.len(), MISTAKES.len(), wrong.join("\n"));
}
