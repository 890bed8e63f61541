//! What a frame takes, and the limits that are found before memory is taken.

use crate::{RasterError, Scene, View};

/// Bytes that [`render`](crate::render) aims to hold at once besides the images.
const AT_ONCE: usize = 1 << 30;
/// Most views at once.
const MOST_VIEWS: usize = 16;

/// Views that [`render`](crate::render) draws at once: their records, were every Gaussian seen, and their pixels fit 1 GiB.
pub(crate) fn views_at_once(scene: &Scene, views: &[View]) -> usize {
    let pixels = views.iter().map(|view| view.camera.pixels()).max().unwrap_or(0);
    let per_view = 100 * scene.cloud.len() + 128 * pixels;
    (AT_ONCE / per_view.max(1)).clamp(1, MOST_VIEWS)
}

/// Most entries of a batch, which take about 30 bytes each, and four for each derivative.
const MOST_ENTRIES: u64 = 1 << 27;

/// Entries of a batch must not take more than about 4 GiB.
pub(crate) fn check_entries(counts: &[u32]) -> Result<(), RasterError> {
    let found: u64 = counts.iter().map(|&count| count as u64).sum();
    if found > MOST_ENTRIES {
        let what = "Gaussians times tiles of one batch".to_string();
        return Err(RasterError::TooLarge { what, limit: MOST_ENTRIES, found });
    }
    Ok(())
}
