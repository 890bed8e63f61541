//! Damaged files: an error or what is good of them, never a panic, never memory on the file's word.

use crate::facts::States;
use crate::made_up::{Numbers, cloud};
use qv_splat::files::spz::{Version, write_version};
use qv_splat::files::{Format, SplatFile, read_any, write};
use qv_splat::{SplatError, captures};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Counts what this thread holds, and the most that it held.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static MOST: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    // A thread that ends has no counters left; its frees do not matter.
    let _ = HELD.try_with(|held| {
        held.set(held.get() + bytes);
        let _ = MOST.try_with(|most| most.set(most.get().max(held.get())));
    });
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Reads, and returns the most memory that it held at a time.
fn measured(bytes: &[u8]) -> (Result<SplatFile, SplatError>, usize) {
    let before = HELD.with(Cell::get);
    MOST.with(|most| most.set(before));
    let result = read_any(bytes);
    (result, (MOST.with(Cell::get) - before) as usize)
}

/// Files of every format and version, with names.
fn files(count: usize) -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    for degree in [0, 2] {
        let cloud = cloud(count, degree, 0);
        for format in Format::ALL {
            out.push((format!("{} {degree}", format.name()), write(&cloud, format).unwrap()));
        }
        for version in [Version::V2, Version::V4] {
            out.push((format!("SPZ {version:?} {degree}"), write_version(&cloud, version).unwrap()));
        }
    }
    out
}

/// A damaged file may cost what it would decode to were it whole, with room to grow.
const FACTOR: usize = 40;
const ROOM: usize = 1 << 20;

fn check(name: &str, bytes: &[u8]) -> bool {
    let (result, most) = measured(bytes);
    assert!(most <= FACTOR * bytes.len() + ROOM, "{name}: {most} bytes for {}", bytes.len());
    match result {
        Ok(file) => {
            assert_eq!(file.cloud.check(), Ok(()), "{name}");
            assert!(file.cloud.means.iter().flatten().all(|x| x.is_finite()), "{name}");
            true
        }
        Err(error) => {
            assert!(error.to_string().contains("expected"), "{name}: {error}");
            false
        }
    }
}

#[test]
fn cut_off_files_are_errors() {
    for (name, bytes) in files(300) {
        assert!(check(&name, &bytes), "{name}");
        for length in (0..bytes.len()).step_by(97) {
            assert!(!check(&name, &bytes[..length]), "{name} cut to {length} of {}", bytes.len());
        }
        assert!(!check(&name, &bytes[..bytes.len() - 1]), "{name} without its last byte");
        // PLY says where its data ends: what follows costs nothing.
        let longer = [&bytes[..], &[0]].concat();
        assert_eq!(check(&name, &longer), bytes.starts_with(b"ply"), "{name} with a byte more");
    }
}

#[test]
fn flipped_bits_never_panic() {
    for (name, bytes) in files(60) {
        let mut n = Numbers::new(11);
        for round in 0..400 {
            let mut damaged = bytes.clone();
            // Half of the rounds within the header, where there is more to break.
            let range = if round % 2 == 0 { bytes.len().min(1200) } else { bytes.len() };
            for _ in 0..=round % 3 {
                damaged[(n.next() * (range - 1) as f32) as usize] ^= 1 << (round / 3 % 8);
            }
            check(&name, &damaged);
        }
    }
}

#[test]
fn huge_claims_cost_nothing() {
    let small = cloud(10, 0, 0);
    for format in [Format::Ply, Format::CompressedPly] {
        let bytes = write(&small, format).unwrap();
        for claim in ["4294967295", "18446744073709551615", "99999999999999999999", "-1"] {
            let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
            let text = String::from_utf8_lossy(&bytes[..end]).replace("vertex 10", &format!("vertex {claim}"));
            let damaged = [text.as_bytes(), &bytes[end..]].concat();
            assert!(!check(format.name(), &damaged), "{} {claim}", format.name());
        }
    }
    let mut streams = write_version(&small, Version::V4).unwrap();
    streams[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(!check("SPZ 4", &streams));
    let glb = write(&small, Format::Gltf).unwrap();
    let text = String::from_utf8_lossy(&glb).find("\"count\":10,").unwrap();
    let mut damaged = glb.clone();
    damaged[text + 8..text + 10].copy_from_slice(b"99");
    assert!(!check("GLB", &damaged));
    assert!(!check("GLB", &with_features(&glb, 60_000)), "features share their numbers in the file and not in memory");
    assert!(check("GLB", &with_features(&glb, 16)));
}

#[test]
fn a_gzip_bomb_is_refused_before_it_opens() {
    let cloud = qv_core::GaussianCloud {
        means: vec![[0.0; 3]; 4_000_000],
        log_scales: vec![[-3.0; 3]; 4_000_000],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 4_000_000],
        opacity_logits: vec![0.0; 4_000_000],
        sh: vec![[0.0; 3]; 4_000_000],
        ..Default::default()
    };
    for version in [Version::V3, Version::V4] {
        let bytes = write_version(&cloud, version).unwrap();
        assert!(bytes.len() < 400_000);
        let (result, most) = measured(&bytes);
        assert!(matches!(result, Err(SplatError::TooLarge { .. })), "{version:?}");
        assert!(most < 200_000, "{version:?}: {most}");
    }
}

#[test]
fn nothing_and_noise_are_errors() {
    for bytes in [&b""[..], b"p", b"ply", b"ply\n", b"\x1f\x8b", b"NGSP", b"glTF", b"{}", b"solid x", &[0; 100]] {
        assert!(!check("noise", bytes), "{bytes:?}");
    }
    let ascii = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1.0\n";
    assert!(read_any(ascii).unwrap_err().to_string().states("ascii 1.0"));
    let points = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
        property float z\nend_header\n\0\0\0\0\0\0\0\0\0\0\0\0";
    let error = read_any(points).unwrap_err().to_string();
    assert_eq!(error, "PLY element vertex: expected property f_dc_0, found x, y, z");
}

#[test]
fn damaged_captures_are_errors() {
    let text = "{\"w\": 4, \"h\": 3, \"fl_x\": 2, \"frames\": [{\"file_path\": \"a\", \"transform_matrix\": \
        [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}";
    assert_eq!(captures::nerfstudio::read(text).unwrap().cameras.len(), 1);
    for length in 0..text.len() {
        assert!(captures::nerfstudio::read(&text[..length]).is_err(), "{length}");
    }
}

/// A GLB whose Gaussians have so many features, all of them the opacities.
fn with_features(glb: &[u8], count: usize) -> Vec<u8> {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut document: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let attributes = &mut document["meshes"][0]["primitives"][0]["attributes"];
    let opacity = attributes["KHR_gaussian_splatting:OPACITY"].clone();
    assert!(opacity.is_u64());
    for feature in 0..count {
        attributes[format!("_FEATURE_{feature}")] = opacity.clone();
    }
    let mut text = serde_json::to_vec(&document).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &glb[20 + length..];
    let size = |n: usize| (n as u32).to_le_bytes();
    [&glb[..8], &size(20 + text.len() + rest.len()), &size(text.len()), b"JSON", &text, rest].concat()
}

/// Rows of Gaussians that are made as they are read.
struct Rows {
    header: std::io::Cursor<Vec<u8>>,
    row: Vec<u8>,
    left: u64,
}

impl std::io::Read for Rows {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let read = self.header.read(out)?;
        if read > 0 {
            return Ok(read);
        }
        let at = (self.row.len() as u64 - self.left % self.row.len() as u64) as usize % self.row.len();
        let count = out.len().min(self.row.len() - at).min(usize::try_from(self.left).unwrap_or(usize::MAX));
        out[..count].copy_from_slice(&self.row[at..at + count]);
        self.left -= count as u64;
        Ok(count)
    }
}

#[test]
fn a_large_ply_is_read_in_a_stream() {
    let count = 100_000usize;
    let cloud = cloud(1, 3, 0);
    let bytes = write(&cloud, Format::Ply).unwrap();
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap().replace("vertex 1\n", &format!("vertex {count}\n"));
    let (row, header) = (bytes[end..].to_vec(), header.into_bytes());
    let (left, length) = ((row.len() * count) as u64, (header.len() + row.len() * count) as u64);
    let before = HELD.with(Cell::get);
    MOST.with(|most| most.set(before));
    let mut source = Rows { header: std::io::Cursor::new(header), row, left };
    let file = qv_splat::files::ply::read_stream(&mut source, length).unwrap();
    let most = (MOST.with(Cell::get) - before) as usize;
    assert_eq!((file.cloud.len(), file.cloud.sh[1..16] == cloud.sh[1..16]), (count, true));
    // 56 bytes and 15 x 12 for harmonics; a file in memory beside them would be as much again.
    let size = count * (56 + 180);
    assert!(most < size + (2 << 20), "{most} bytes for a cloud of {size}");
}
