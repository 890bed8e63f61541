//! Images as cameras see them: turned as EXIF says, where the camera is that of the turned image.

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader};
use std::io::{BufRead, Seek};

/// Which image the cameras of a capture are of, where EXIF tells a viewer to turn it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shown {
    /// The one that a viewer shows, unless only the stored one has the camera's size.
    #[default]
    Turned,
    /// The one that is stored. COLMAP passes over the orientation of EXIF (colmap/colmap, pull request 1406).
    Stored,
}

/// Width and height of an image as a viewer shows it; only the head of the file is read.
///
/// # Errors
/// No image that is known, in words.
pub fn size(file: impl BufRead + Seek) -> Result<[u32; 2], String> {
    let reader = ImageReader::new(file).with_guessed_format().map_err(|e| e.to_string())?;
    let mut decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let turn = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    Ok(if swaps(turn) { [height, width] } else { [width, height] })
}

/// Whether EXIF tells a viewer to turn an image; not so where it is no image.
pub fn is_turned(bytes: &[u8]) -> bool {
    let reader = ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format();
    let decoder = reader.ok().and_then(|reader| reader.into_decoder().ok());
    let turn = decoder.and_then(|mut decoder| decoder.orientation().ok());
    turn.is_some_and(|turn| turn != Orientation::NoTransforms)
}

/// An image of the size that its camera has, or as it is stored; and what was done with the orientation that EXIF tells, if it tells one.
///
/// # Errors
/// No image that is known, in words.
pub fn decode(bytes: &[u8], size: [u32; 2], shown: Shown) -> Result<(DynamicImage, Option<String>), String> {
    let reader = ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let turn = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    if turn == Orientation::NoTransforms {
        return Ok((image, None));
    }
    let stored = [image.width(), image.height()];
    let turned = if swaps(turn) { [stored[1], stored[0]] } else { stored };
    let number = turn.to_exif();
    let is_turned = size == turned && (shown == Shown::Turned || size != stored);
    if is_turned {
        image.apply_orientation(turn);
    }
    let what = match (is_turned, size == stored) {
        (true, _) => format!("EXIF orientation {number}: turned to {} x {}", size[0], size[1]),
        (false, true) => format!("EXIF orientation {number}: not turned, since the camera is of the image as stored"),
        // Its size is an error, which the caller tells.
        (false, false) => return Ok((image, None)),
    };
    Ok((image, Some(what)))
}

fn swaps(turn: Orientation) -> bool {
    // EXIF 2.32, tag 0x0112: 5 to 8 exchange rows and columns.
    turn.to_exif() > 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageFormat, Luma};

    /// A JPEG of 16 x 8, bright in its left half, with an orientation.
    fn jpeg(orientation: u8) -> Vec<u8> {
        let image = GrayImage::from_fn(16, 8, |x, _| Luma([if x < 8 { 250 } else { 5 }]));
        let mut out = std::io::Cursor::new(vec![]);
        image.write_to(&mut out, ImageFormat::Jpeg).unwrap();
        let plain = out.into_inner();
        // APP1 with one entry of little-endian TIFF.
        let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        let length = (exif.len() as u16 + 2).to_be_bytes();
        [&plain[..2], &[0xff, 0xe1], &length, &exif, &plain[2..]].concat()
    }

    #[test]
    fn an_image_is_turned_to_its_camera() {
        for (orientation, bright) in [(6u8, [4, 2]), (8, [4, 13]), (5, [4, 2])] {
            let file = jpeg(orientation);
            assert_eq!(size(std::io::Cursor::new(&file)).unwrap(), [8, 16]);
            let (image, told) = decode(&file, [8, 16], Shown::Turned).unwrap();
            assert!(told.unwrap().contains(&format!("EXIF orientation {orientation}: turned to 8 x 16")));
            let at = |x, y| image.to_luma8().get_pixel(x, y).0[0];
            assert!(at(bright[0], bright[1]) > 200 && at(bright[0], 15 - bright[1]) < 60, "{orientation}");
            // A camera of the stored image has it as stored.
            let (image, told) = decode(&file, [16, 8], Shown::Turned).unwrap();
            assert_eq!((image.width(), told.unwrap().contains("not turned")), (16, true));
        }
        let upside_down = jpeg(3);
        let left = |shown| decode(&upside_down, [16, 8], shown).unwrap().0.to_luma8().get_pixel(2, 4).0[0];
        assert!(left(Shown::Turned) < 60 && left(Shown::Stored) > 200);
        assert_eq!(decode(&jpeg(1), [16, 8], Shown::Turned).unwrap().1, None);
        assert_eq!(decode(&jpeg(6), [9, 9], Shown::Turned).unwrap().1, None);
        assert!(is_turned(&jpeg(6)) && is_turned(&upside_down) && !is_turned(&jpeg(1)) && !is_turned(&[1, 2]));
        assert!(decode(&[1, 2], [1, 1], Shown::Turned).is_err() && size(std::io::Cursor::new([1, 2])).is_err());
    }
}
