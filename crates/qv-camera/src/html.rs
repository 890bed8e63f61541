//! Photographs beside what the scene shows, for report.html.

use crate::Looks;
use qv_gap::export::words::{escape, percent, significant, words};
use qv_gap::report::Sight;
use std::fmt::Write;

/// A section with pictures inside, in the classes of the report's own style sheet.
pub fn section(sight: &Sight, looks: &[Looks]) -> String {
    let gap = &sight.gap;
    let mut text = format!(
        "<h2>What the camera sees</h2><div class=\"card\"><p>{}</p><p class=\"soft small\">{} images; brightness differs by {} as \
         measured, {} corrected, {} where each agrees best; closed {} in images that the fit has not seen. They scatter by {} mrad \
         and {} mm.</p>",
        escape(&sight.sentence),
        sight.photographs,
        significant(gap.before, 3),
        significant(gap.after, 3),
        significant(gap.floor, 3),
        percent(gap.closed),
        significant(1e3 * sight.noise.rotation, 2),
        significant(1e3 * sight.noise.translation, 2),
    );
    for cause in &sight.causes {
        let values: Vec<String> = cause
            .parameters
            .iter()
            .map(|p| {
                let [low, high] = p.ci95.map(|x| significant(x, 3));
                format!("{} {} {} ({low} to {high})", words(&p.name), significant(p.value, 3), p.unit)
            })
            .collect();
        let _ = write!(text, "<p><b>{}</b>: {}</p>", escape(&words(&cause.effect)), escape(&values.join(", ")));
    }
    if !looks.is_empty() {
        text += "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"images\"><table><tr><th>image<th>scene as measured<th>difference<th>scene corrected<th>difference</tr>";
        looks.iter().for_each(|looks| text += &row(looks));
        text += "</table></div>";
    }
    text + "</div>"
}

fn row(looks: &Looks) -> String {
    let pictures = [
        ("image", &looks.photograph),
        ("scene as measured", &looks.measured),
        ("difference before", &looks.difference_before),
        ("scene corrected", &looks.corrected),
        ("difference after", &looks.difference_after),
    ];
    let cells: String = pictures
        .iter()
        .map(|(name, rgb)| match png(looks.width, looks.height, rgb) {
            Some(bytes) => format!(
                "<td><img alt=\"{name}\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{}\">",
                looks.width,
                looks.height,
                base64(&bytes)
            ),
            None => "<td>–".into(),
        })
        .collect();
    format!("<tr>{cells}</tr><tr><td class=\"soft small\" colspan=\"5\">{} s</tr>", significant(looks.time, 4))
}

/// A PNG of an image of three bytes for each pixel; `None` when there are not as many bytes.
fn png(width: usize, height: usize, rgb: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(rgb).ok()?;
    writer.finish().ok()?;
    Some(out)
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|i| u32::from(chunk.get(i).copied().unwrap_or(0)));
        let word = a << 16 | b << 8 | c;
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k) & 63) as usize] as char;
            out.push(if k <= chunk.len() { digit } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_the_standard_has_it() {
        // RFC 4648, section 10.
        for (text, expected) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(text.as_bytes()), expected);
        }
    }

    #[test]
    fn a_picture_is_a_png_or_nothing() {
        let bytes = png(2, 1, &[1, 2, 3, 4, 5, 6]).unwrap();
        assert_eq!(&bytes[..4], b"\x89PNG");
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        let mut back = vec![0; 6];
        reader.next_frame(&mut back).unwrap();
        assert_eq!(back, [1, 2, 3, 4, 5, 6]);
        assert!(png(2, 2, &[0; 3]).is_none());
    }
}
