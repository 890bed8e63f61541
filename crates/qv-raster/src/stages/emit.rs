//! One entry for each Gaussian and tile that it touches.

use super::project::ProjectedGaussian;
use crate::ellipse::Ellipse;
use crate::lens::Batch;
use rayon::prelude::*;

/// Entries in the order in which they are made: by depth, then by row and column of tiles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Entries {
    /// Tile of each entry, counted over all views.
    pub tiles: Vec<u32>,
    /// Record of each entry.
    pub records: Vec<u32>,
    /// First entry of each record; its entries follow one another.
    pub first: Vec<u32>,
}

/// The loop that counted the tiles, in the order of depth. There must be fewer than 2^32 entries.
pub fn emit(batch: &Batch, records: &[ProjectedGaussian], counts: &[u32], order: &[u32]) -> Entries {
    let mut first = vec![0; records.len()];
    let mut total = 0;
    for &index in order {
        first[index as usize] = total;
        total += counts[index as usize];
    }
    let mut out = Entries { tiles: vec![0; total as usize], records: vec![0; total as usize], first };
    let mut slots = Vec::with_capacity(order.len());
    let (mut tiles, mut owners) = (out.tiles.as_mut_slice(), out.records.as_mut_slice());
    for &index in order {
        let count = counts[index as usize] as usize;
        let (tile_slot, tiles_left) = tiles.split_at_mut(count);
        let (owner_slot, owners_left) = owners.split_at_mut(count);
        (tiles, owners) = (tiles_left, owners_left);
        if count > 0 {
            slots.push((index, tile_slot, owner_slot));
        }
    }
    slots.into_par_iter().with_min_len(256).for_each(|(index, tiles, owners)| {
        let record = &records[index as usize];
        let lens = &batch.lenses[record.view as usize];
        let ellipse = Ellipse::new(record.mean, record.factor, record.opacity);
        let mut at = 0;
        let [top, bottom] = ellipse.rows(lens);
        for row in top..bottom {
            let [first, end] = ellipse.row(row, lens);
            for column in first..end {
                tiles[at] = lens.first_tile + row * lens.tiles[0] + column;
                owners[at] = index;
                at += 1;
            }
        }
    });
    out
}
