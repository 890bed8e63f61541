//! The page of a scene: held-out images beside what is drawn there, where the two differ, and how training went.

use super::scores::HeldOutScores;
use super::watch::CurvePoint;
use crate::Failure;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{RgbImage, imageops};
use qv_page::parts::{card, titled_card};
use qv_page::{Board, Line, Look, Page, Panel, Table, escape, fixed};
use qv_raster::Image;
use qv_splat::train::{Dataset, Model, Photograph, Score, drawn};

/// Held-out images that are shown at most, evenly over all of them.
const SHOWN: usize = 12;
/// Width of an image on the page at most \[px\].
const WIDTH: u32 = 560;
/// Factor on errors, so that a tenth of the range is as bright as can be.
const ERROR_FACTOR: f32 = 10.0;
/// Quality of the page's images, 1 to 100.
const QUALITY: u8 = 85;
const STYLE: &str = ".three{display:grid;grid-template-columns:repeat(auto-fit,minmax(220px,1fr));gap:8px}.three figure{margin:0}\
                     .three img{width:100%;height:auto;display:block}";

/// What the page shows.
pub(super) struct Summary<'a> {
    pub model: &'a Model,
    pub dataset: &'a Dataset,
    /// Held-out images with the cameras that they are scored with.
    pub looked_at: &'a [Photograph],
    pub scores: &'a HeldOutScores,
    /// How training went.
    pub curve: &'a [CurvePoint],
    /// Whether images of masks lie beside the page.
    pub has_masks: bool,
}

impl Summary<'_> {
    /// The whole page.
    ///
    /// # Errors
    /// An image cannot be drawn or encoded.
    pub fn to_html(&self) -> Result<String, Failure> {
        let step = self.looked_at.len().div_ceil(SHOWN).max(1);
        let chosen: Vec<usize> = (0..self.looked_at.len()).step_by(step).collect();
        let of_image = |&k: &usize| self.of_image(&self.looked_at[k], &self.scores.drawn[k]);
        let images = chosen.iter().map(of_image).collect::<Result<Vec<String>, Failure>>()?;
        let heading = match images.is_empty() {
            true => "<p class=\"soft\">No image was held out: <code>--hold-out</code> was 0, or the capture is too small.</p>".into(),
            false => format!(
                "<h2>Held-out images: captured, drawn, error times {ERROR_FACTOR:.0}</h2><p class=\"soft\">{} of {}. Training has not seen them.</p>",
                images.len(),
                self.looked_at.len()
            ),
        };
        let masks =
            if self.has_masks { "<p><a href=\"masks/\">What moves and was left out (masks)</a></p>" } else { "" };
        let body = format!("{}{}{masks}{heading}{}", self.table(), self.board().to_card(), images.concat());
        Ok(Page { title: "Scene of Gaussians", style: STYLE, body: &body, ..Page::default() }.to_html())
    }

    fn table(&self) -> String {
        let mut table = Table::with_left(&["figure", "value"], &[0]);
        let mean = Score::mean(&self.scores.drawn);
        let of = |value: Option<f64>, decimals: usize| value.map_or("-".into(), |x| fixed(x, decimals));
        table.row(&["PSNR of held-out images [dB]", &of(mean.map(|m| m.psnr), 2)]);
        table.row(&["SSIM of held-out images", &of(mean.map(|m| m.ssim), 4)]);
        table.row(&["images to learn from", &self.dataset.training.len().to_string()]);
        table.row(&["Gaussians", &self.model.cloud.len().to_string()]);
        card(&table.to_html())
    }

    /// Loss and PSNR over steps.
    fn board(&self) -> Board {
        let mut board = Board::new("step");
        if self.curve.len() < 2 {
            return board;
        }
        let mut line = |name: &str, step: f64, points: &[&CurvePoint], of: fn(&CurvePoint) -> f64| {
            let x = board.column(&points.iter().map(|p| f64::from(p.step)).collect::<Vec<_>>(), 1.0);
            let y = board.column(&points.iter().map(|p| of(p)).collect::<Vec<_>>(), step);
            Line::new(name, "c0", x, y)
        };
        let all: Vec<&CurvePoint> = self.curve.iter().collect();
        let loss = line("loss", 1e-5, &all, |p| p.loss);
        let judged: Vec<&CurvePoint> = self.curve.iter().filter(|p| p.psnr.is_finite()).collect();
        let psnr = line("images of training", 1e-3, &judged, |p| p.psnr).looking(Look::Dots);
        let panel = |title: &str, unit: &str, line: Line| Panel {
            title: title.into(),
            unit: unit.into(),
            lines: vec![line],
            half: true,
            ..Panel::default()
        };
        board.panels.push(panel("Loss", "", loss));
        if !judged.is_empty() {
            board.panels.push(panel("PSNR of some images", "dB", psnr));
        }
        board
    }

    fn of_image(&self, photograph: &Photograph, score: &Score) -> Result<String, Failure> {
        let image = drawn(&self.model.cloud, &photograph.camera, self.dataset)?;
        let [photographed, rendered, error] = triple(photograph, &image);
        let mut figures = String::new();
        for (what, picture) in [("captured", photographed), ("drawn", rendered), ("error", error)] {
            let data = encoded(picture)?;
            figures += &format!("<figure><img alt=\"{what}\" src=\"data:image/jpeg;base64,{data}\"></figure>");
        }
        let title = format!("{}: {} dB, SSIM {}", photograph.name, fixed(score.psnr, 2), fixed(score.ssim, 4));
        Ok(titled_card(&escape(&title), &format!("<div class=\"three\">{figures}</div>")))
    }
}

/// A photograph, what is drawn there, and how far the two are apart; masked pixels are black in the last.
fn triple(photograph: &Photograph, image: &Image) -> [RgbImage; 3] {
    let size = [image.width as u32, image.height as u32];
    let (bytes, wanted) = (image.colour_u8(), &photograph.pixels.rgba);
    let of = |pixel: &dyn Fn(usize) -> [u8; 3]| {
        RgbImage::from_fn(size[0], size[1], |x, y| image::Rgb(pixel(y as usize * size[0] as usize + x as usize)))
    };
    let rendered = |k: usize| [bytes[3 * k], bytes[3 * k + 1], bytes[3 * k + 2]];
    let error = |k: usize| {
        let off: f32 = rendered(k).iter().zip(&wanted[k]).map(|(a, b)| f32::from(a.abs_diff(*b))).sum::<f32>() / 3.0;
        [if wanted[k][3] == 0 { 0 } else { (ERROR_FACTOR * off).min(255.0) as u8 }; 3]
    };
    [of(&|k| [wanted[k][0], wanted[k][1], wanted[k][2]]), of(&rendered), of(&error)]
}

/// As a JPEG in base64, no wider than the page needs.
fn encoded(picture: RgbImage) -> Result<String, Failure> {
    let (width, height) = picture.dimensions();
    let small = match width > WIDTH {
        true => {
            imageops::resize(&picture, WIDTH, (height * WIDTH).div_ceil(width).max(1), imageops::FilterType::Triangle)
        }
        false => picture,
    };
    let mut jpeg = Vec::new();
    small.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, QUALITY))?;
    Ok(STANDARD.encode(jpeg))
}
