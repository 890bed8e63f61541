//! Devices, pipes and links in the place of what is written.

use super::{command, contents, directory, done, qv, recording, remarks};
use std::fs;
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, symlink};
use std::process::Command;

#[test]
fn a_lock_that_is_a_link_is_not_followed() {
    let root = directory("lock");
    recording(&root.join("run"));
    fs::create_dir_all(root.join("out")).unwrap();
    fs::write(root.join("victim"), "all my work").unwrap();
    for is_hard in [false, true] {
        let (victim, lock) = (root.join("victim"), root.join("out/qv.lock"));
        if is_hard { fs::hard_link(victim, lock) } else { symlink(victim, lock) }.unwrap();
        let (code, out, err) = qv(&root, "replay run --out out");
        assert!(code == 1 && !out.contains("my work") && !err.contains("my work"), "{out}{err}");
        assert_eq!(fs::read_to_string(root.join("victim")).unwrap(), "all my work");
        fs::remove_file(root.join("out/qv.lock")).unwrap();
    }
    fs::write(root.join("out/qv.lock"), "a file of mine").unwrap();
    let (code, _, err) = qv(&root, "replay run --out out");
    assert!(code == 1 && !err.contains("of mine"), "{err}");
    assert_eq!(fs::read_to_string(root.join("out/qv.lock")).unwrap(), "a file of mine");
    fs::write(root.join("out/qv.lock"), "process 1 on \u{1b}[2J another").unwrap();
    let (code, _, err) = qv(&root, "replay run --out out");
    assert!(code == 0 && !err.contains('\u{1b}'), "{err}");
}

#[test]
fn results_in_the_place_of_links_leave_what_they_lead_to() {
    let root = directory("result_links");
    recording(&root.join("run"));
    fs::create_dir_all(root.join("out")).unwrap();
    fs::write(root.join("victim"), "all my work").unwrap();
    symlink(root.join("victim"), root.join("out/replay.json")).unwrap();
    symlink(root.join("victim"), root.join("out/.qv-files")).unwrap();
    let (code, _, err) = qv(&root, "replay run --out out");
    assert!(code == 1 && !err.contains("my work"), "{err}");
    fs::remove_file(root.join("out/.qv-files")).unwrap();
    done(&root, "replay run --out out");
    assert_eq!(fs::read_to_string(root.join("victim")).unwrap(), "all my work");
    assert!(fs::symlink_metadata(root.join("out/replay.json")).unwrap().is_file());
}

#[test]
fn devices_and_pipes_are_written_into() {
    let root = directory("devices");
    recording(&root.join("run"));
    done(&root, "diagnose run --out d");
    done(&root, "view d --out /dev/null");
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    let (code, out, err) = qv(&root, "view d --out /dev/stdout");
    assert!(code == 0 && out.contains("<html"), "{err}");
    assert!(Command::new("mkfifo").arg(root.join("pipe")).status().unwrap().success());
    let child = command(&root, "view d --out pipe").spawn().unwrap();
    let mut page = String::new();
    fs::File::open(root.join("pipe")).unwrap().read_to_string(&mut page).unwrap();
    let (code, _, err) = remarks(&child.wait_with_output().unwrap());
    assert!(code == 0 && page.contains("<html") && page.contains("</html>"), "{err}");
    assert!(fs::metadata(root.join("pipe")).unwrap().file_type().is_fifo());
    // A link stays a link.
    fs::create_dir_all(root.join("pages")).unwrap();
    symlink("pages/now.html", root.join("link.html")).unwrap();
    done(&root, "view d --out link.html");
    assert!(fs::symlink_metadata(root.join("link.html")).unwrap().file_type().is_symlink());
    assert_eq!(contents(&root.join("pages")).into_keys().collect::<Vec<_>>(), ["now.html"]);
}
