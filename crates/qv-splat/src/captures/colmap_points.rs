//! COLMAP's points: `points3D.txt` and `points3D.bin` (colmap.github.io, *Output format*, COLMAP 3.x).

use crate::SplatError;
use crate::cursor::Cursor;
use crate::error::off;
use crate::files::Points;

/// Bytes of an entry of a track.
const TRACK: u64 = 8;

/// Reads `points3D.txt`: number, place, colour, error and track of each, a line each.
///
/// # Errors
/// Names the line that is off.
pub fn read_text(text: &str) -> Result<Points, SplatError> {
    let mut points = Points::default();
    for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.starts_with('#') && !line.trim().is_empty())
    {
        let place = || format!("points3D.txt, line {}", number + 1);
        let words = line.split_whitespace().skip(1).take(6).map(|word| word.parse::<f32>().ok());
        let numbers: Option<Vec<f32>> = words.collect();
        let Some([x, y, z, r, g, b]) = numbers.as_deref() else {
            return Err(off(place(), "number, x, y, z, red, green, blue", line.chars().take(60).collect::<String>()));
        };
        points.push([*x, *y, *z], [r, g, b].map(|c| c / 255.0));
    }
    Ok(points)
}

/// Reads `points3D.bin`.
///
/// # Errors
/// Names the byte where the file ends early.
pub fn read_binary(bytes: &[u8]) -> Result<Points, SplatError> {
    let mut cursor = Cursor::new(bytes, "points3D.bin");
    let mut points = Points::default();
    for _ in 0..cursor.u64("count")? {
        cursor.u64("point")?;
        let mut place = [0.0; 3];
        for x in &mut place {
            *x = cursor.f64("point")? as f32;
        }
        let colour = [cursor.u8("point")?, cursor.u8("point")?, cursor.u8("point")?];
        cursor.f64("point")?;
        let track = cursor.u64("track")?;
        cursor.take(track.saturating_mul(TRACK), "track")?;
        points.push(place, colour.map(|c| f32::from(c) / 255.0));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn text_and_bytes_say_the_same() {
        let text = read_text("# a comment\n7 1.0 2.5 -3 255 0 51 0.4 1 2 3 4\n\n").unwrap();
        let mut bytes = 1u64.to_le_bytes().to_vec();
        bytes.extend(7u64.to_le_bytes());
        [1.0f64, 2.5, -3.0].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([255, 0, 51]);
        bytes.extend(0.4f64.to_le_bytes());
        bytes.extend(2u64.to_le_bytes());
        bytes.extend([0; 16]);
        assert_eq!(
            text,
            Points { places: vec![[1.0, 2.5, -3.0]], colours: vec![[1.0, 0.0, 0.2]], ..Default::default() }
        );
        assert_eq!(read_binary(&bytes), Ok(text));
        assert!(read_binary(&bytes[..bytes.len() - 1]).is_err());
        assert!(read_text("7 1 2\n").unwrap_err().to_string().states("points3D.txt 1"));
    }
}
