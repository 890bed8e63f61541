//! Where the entries of each tile begin and end.

/// First entry of each tile and the one after its last, given the tiles of the sorted entries.
pub fn ranges(sorted_tiles: impl Iterator<Item = u32>, tiles: usize) -> Vec<[u32; 2]> {
    let mut out = vec![[0, 0]; tiles];
    for (index, tile) in sorted_tiles.enumerate() {
        let range = &mut out[tile as usize];
        if range[1] == 0 {
            range[0] = index as u32;
        }
        range[1] = index as u32 + 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_the_entries_of_their_tile() {
        assert_eq!(ranges([0, 0, 2, 2, 2, 3].into_iter(), 5), [[0, 2], [0, 0], [2, 5], [5, 6], [0, 0]]);
    }
}
