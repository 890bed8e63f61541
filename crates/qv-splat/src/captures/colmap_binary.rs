//! COLMAP's binary files, little-endian.

use super::colmap_cameras::{Intrinsics, Model, PosedImage, pose};
use crate::SplatError;
use crate::cursor::Cursor;
use crate::error::off;
use std::collections::BTreeMap;

/// Bytes of a point of an image: x, y, number of the point.
const POINT: u64 = 24;
/// Longest name of an image that is looked through for its end, bytes.
const LONGEST_NAME: usize = 4096;

/// `cameras.bin`: count, then number, model, width, height, parameters of each.
pub fn cameras(bytes: &[u8]) -> Result<BTreeMap<u32, Intrinsics>, SplatError> {
    let mut cursor = Cursor::new(bytes, "cameras.bin");
    let mut out = BTreeMap::new();
    for _ in 0..cursor.u64("count")? {
        let place = format!("cameras.bin, byte {}", cursor.at());
        let (id, model) = (cursor.u32("camera")?, cursor.u32("camera")?);
        let model = Model::of_number(model, &place)?;
        let size = [cursor.u64("camera")?, cursor.u64("camera")?];
        let count = model.parameters();
        let numbers: Vec<f64> = (0..count).map(|_| cursor.f64("camera")).collect::<Result<_, _>>()?;
        out.insert(id, model.intrinsics(size, &numbers, &place)?);
    }
    end(&cursor, "cameras.bin")?;
    Ok(out)
}

/// `images.bin`: count, then number, quaternion, translation, camera, name up to a zero, points of each.
pub fn images(bytes: &[u8]) -> Result<Vec<PosedImage>, SplatError> {
    let mut cursor = Cursor::new(bytes, "images.bin");
    let mut out = Vec::new();
    for _ in 0..cursor.u64("count")? {
        let place = format!("images.bin, byte {}", cursor.at());
        cursor.u32("image")?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = cursor.f64("image")?;
        }
        let [w, x, y, z, tx, ty, tz] = numbers;
        let camera_from_world = pose([w, x, y, z], [tx, ty, tz], &place)?;
        let camera = cursor.u32("image")?;
        let name = name(&mut cursor, &place)?;
        let points = cursor.u64("points of an image")?;
        cursor.take(points.saturating_mul(POINT), "points of an image")?;
        out.push(PosedImage { camera, camera_from_world, name });
    }
    end(&cursor, "images.bin")?;
    Ok(out)
}

fn name(cursor: &mut Cursor, place: &str) -> Result<String, SplatError> {
    let mut out = Vec::new();
    loop {
        match cursor.u8("name of an image")? {
            0 => break,
            _ if out.len() == LONGEST_NAME => return Err(off(place, "a name of at most 4096 bytes", "a longer one")),
            byte => out.push(byte),
        }
    }
    String::from_utf8(out).map_err(|error| off(place, "a name in UTF-8", error))
}

fn end(cursor: &Cursor, file: &str) -> Result<(), SplatError> {
    match cursor.left() {
        0 => Ok(()),
        left => Err(off(format!("{file}, byte {}", cursor.at()), "the end of the file", format!("{left} bytes more"))),
    }
}
