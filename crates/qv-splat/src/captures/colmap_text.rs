//! COLMAP's text files.

use super::colmap_cameras::{Intrinsics, Model, PosedImage, pose};
use crate::SplatError;
use crate::error::off;
use std::collections::BTreeMap;
use std::str::FromStr;

/// Lines with their numbers, without comments.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(at, line)| (at + 1, line)).filter(|(_, line)| !line.starts_with('#'))
}

/// One word as a number.
fn parse<T: FromStr>(word: &str, place: &str) -> Result<T, SplatError> {
    word.parse().map_err(|_| off(place, "a number", word))
}

/// `cameras.txt`: number, model, width, height, parameters.
pub fn cameras(text: &str) -> Result<BTreeMap<u32, Intrinsics>, SplatError> {
    let mut out = BTreeMap::new();
    for (number, line) in lines(text).filter(|(_, line)| !line.trim().is_empty()) {
        let place = format!("cameras.txt, line {number}");
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, model, width, height, rest @ ..] = &words[..] else {
            return Err(off(place, "number, model, width, height, parameters", line));
        };
        let model = Model::of_name(model, &place)?;
        if rest.len() != model.parameters() {
            return Err(off(place, format!("{} numbers of the model", model.parameters()), rest.len()));
        }
        let numbers: Vec<f64> = rest.iter().map(|word| parse(word, &place)).collect::<Result<_, _>>()?;
        let size = [parse(width, &place)?, parse(height, &place)?];
        out.insert(parse(id, &place)?, model.intrinsics(size, &numbers, &place)?);
    }
    Ok(out)
}

/// `images.txt`: two lines for each image, of which the second, with its points, may be empty and is not read.
pub fn images(text: &str) -> Result<Vec<PosedImage>, SplatError> {
    let mut out = Vec::new();
    let mut lines = lines(text);
    while let Some((number, line)) = lines.next() {
        // Blank lines before an image; those after one belong to it.
        if line.trim().is_empty() {
            continue;
        }
        let place = format!("images.txt, line {number}");
        let mut rest = line.trim();
        let mut words = Vec::with_capacity(9);
        while words.len() < 9 {
            let Some((word, after)) = rest.split_once(char::is_whitespace) else {
                return Err(off(place, "number, quaternion, translation, camera, name", line));
            };
            words.push(word);
            rest = after.trim_start();
        }
        let numbers: Vec<f64> = words[1..8].iter().map(|word| parse(word, &place)).collect::<Result<_, _>>()?;
        let [w, x, y, z, tx, ty, tz] = numbers[..] else {
            return Err(off(place, "seven numbers of a pose", numbers.len()));
        };
        let camera_from_world = pose([w, x, y, z], [tx, ty, tz], &place)?;
        out.push(PosedImage { camera: parse(words[8], &place)?, camera_from_world, name: rest.into() });
        if let Some((number, line)) = lines.next() {
            check_points(number, line)?;
        }
    }
    Ok(out)
}

/// The line after an image: what it saw, `x y point` again and again, or nothing. Were it the next image, every second one would be lost.
fn check_points(number: usize, line: &str) -> Result<(), SplatError> {
    let count = line.split_whitespace().count();
    if count.is_multiple_of(3) && line.split_whitespace().all(|word| word.parse::<f64>().is_ok()) {
        return Ok(());
    }
    let expected = "the points of the image before it, x y number of each, or an empty line";
    Err(off(format!("images.txt, line {number}"), expected, line))
}
