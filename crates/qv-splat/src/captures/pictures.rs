//! Images as cameras see them: turned as EXIF says, where the camera is that of the turned image.

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader};
use std::io::{BufRead, Seek};

/// Which image the cameras of a capture are of, where EXIF shows a viewer to turn it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ImageOrientation {
    /// The one that a viewer shows, unless only the stored one has the camera's size.
    #[default]
    Turned,
    /// The one that is stored. COLMAP passes over the orientation of EXIF (colmap/colmap, pull request 1406).
    Stored,
}

/// Bytes that any image may decode to: one of a single colour is packed to nearly nothing.
const ANY_BYTES: u64 = 256 << 20;
/// Decoded bytes for each packed one, and bytes of the largest image that is read. Photographs have 3 to 30.
const RATIO: u64 = 100;
const MOST_BYTES: u64 = 2 << 30;

/// The decoder of an image that is no larger than its packed bytes allow.
fn decoder(bytes: &[u8]) -> Result<impl ImageDecoder + '_, String> {
    let reader = ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let most = (ANY_BYTES + RATIO * bytes.len() as u64).min(MOST_BYTES);
    if decoder.total_bytes() > most {
        let (width, height) = decoder.dimensions();
        return Err(format!(
            "expected at most {most} bytes of pixels in a file of {} bytes, found {width} x {height} pixels",
            bytes.len()
        ));
    }
    Ok(decoder)
}

/// An image as it is stored.
///
/// # Errors
/// No image that is known, or one that claims more pixels than its bytes can hold, in words.
pub fn read(bytes: &[u8]) -> Result<DynamicImage, String> {
    DynamicImage::from_decoder(decoder(bytes)?).map_err(|e| e.to_string())
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

/// Whether EXIF shows a viewer to turn an image; not so where it is no image.
pub fn is_turned(bytes: &[u8]) -> bool {
    let turn = decoder(bytes).ok().and_then(|mut decoder| decoder.orientation().ok());
    turn.is_some_and(|turn| turn != Orientation::NoTransforms)
}

/// An image of the size that its camera has, or as it is stored; and what was done with the orientation that EXIF shows, if it shows one.
///
/// # Errors
/// As [`read`].
pub fn decode(bytes: &[u8], size: [u32; 2], shown: ImageOrientation) -> Result<(DynamicImage, Option<String>), String> {
    let mut decoder = decoder(bytes)?;
    let turn = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    if turn == Orientation::NoTransforms {
        return Ok((image, None));
    }
    let stored = [image.width(), image.height()];
    let turned = if swaps(turn) { [stored[1], stored[0]] } else { stored };
    let number = turn.to_exif();
    let is_turned = size == turned && (shown == ImageOrientation::Turned || size != stored);
    if is_turned {
        image.apply_orientation(turn);
    }
    let what = match (is_turned, size == stored) {
        (true, _) => format!("EXIF orientation {number}: turned to {} x {}", size[0], size[1]),
        (false, true) => format!("EXIF orientation {number}: not turned, since the camera is of the image as stored"),
        // Its size is an error, which the caller shows.
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
    use crate::facts::States;
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
    fn an_image_larger_than_its_bytes_is_refused() {
        // The two sizes of the frame's head (SOF0) follow its marker, length and depth.
        let mut file = jpeg(1);
        let at = file.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap() + 5;
        file[at..at + 4].fill(0xff);
        assert_eq!(size(std::io::Cursor::new(&file)).unwrap(), [65535; 2]);
        assert!(
            read(&file).is_err() && decode(&file, [65535; 2], ImageOrientation::Turned).is_err() && !is_turned(&file)
        );
        assert!(read(&jpeg(6)).is_ok_and(|image| [image.width(), image.height()] == [16, 8]));
    }

    #[test]
    fn an_image_is_turned_to_its_camera() {
        for (orientation, bright) in [(6u8, [4, 2]), (8, [4, 13]), (5, [4, 2])] {
            let file = jpeg(orientation);
            assert_eq!(size(std::io::Cursor::new(&file)).unwrap(), [8, 16]);
            let (image, remarks) = decode(&file, [8, 16], ImageOrientation::Turned).unwrap();
            assert!(remarks.unwrap().contains(&format!("EXIF orientation {orientation}: turned to 8 x 16")));
            let at = |x, y| image.to_luma8().get_pixel(x, y).0[0];
            assert!(at(bright[0], bright[1]) > 200 && at(bright[0], 15 - bright[1]) < 60, "{orientation}");
            // A camera of the stored image has it as stored.
            let (image, remarks) = decode(&file, [16, 8], ImageOrientation::Turned).unwrap();
            assert_eq!((image.width(), remarks.unwrap().states("turned")), (16, true));
        }
        let upside_down = jpeg(3);
        let left = |shown| decode(&upside_down, [16, 8], shown).unwrap().0.to_luma8().get_pixel(2, 4).0[0];
        assert!(left(ImageOrientation::Turned) < 60 && left(ImageOrientation::Stored) > 200);
        assert_eq!(decode(&jpeg(1), [16, 8], ImageOrientation::Turned).unwrap().1, None);
        assert_eq!(decode(&jpeg(6), [9, 9], ImageOrientation::Turned).unwrap().1, None);
        assert!(is_turned(&jpeg(6)) && is_turned(&upside_down) && !is_turned(&jpeg(1)) && !is_turned(&[1, 2]));
        assert!(
            decode(&[1, 2], [1, 1], ImageOrientation::Turned).is_err() && size(std::io::Cursor::new([1, 2])).is_err()
        );
    }
}
