//! Files of other programs that are not read: what they are by their first bytes, and what to make of them.

/// Bytes that say what a file is.
pub const HEAD: usize = 1 << 16;

/// What a file is whose first bytes are `head`, and what to do with it; `None` where that is not known.
pub fn named(head: &[u8]) -> Option<&'static str> {
    let has = |word: &[u8]| head.windows(word.len()).any(|w| w == word);
    Some(match head {
        [b'P', b'K', 3, 4, ..] if has(b"data.pkl") || has(b"constants.pkl") => {
            "a PyTorch archive (torch.save, TorchScript): export the policy to ONNX (torch.onnx.export)"
        }
        [b'P', b'K', 3, 4, ..] if has(b".npy") => {
            "a NumPy archive (.npz): write its arrays as run.csv with columns time, pos.JOINT, cmd_pos.JOINT"
        }
        [b'P', b'K', 3, 4, ..] => "a ZIP archive: unpack it",
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => {
            "a NumPy array (.npy): write it as run.csv with columns time, pos.JOINT, cmd_pos.JOINT"
        }
        [0x89, b'H', b'D', b'F', ..] => {
            "an HDF5 file: write its data sets as run.csv with columns time, pos.JOINT, cmd_pos.JOINT"
        }
        [0x80, 2..=5, ..] => {
            "a Python pickle: what it holds must be written by Python, a policy as ONNX, a log as run.csv"
        }
        [0x1f, 0x8b, ..] => "a gzip file: unpack it (gunzip)",
        [b'B', b'Z', b'h', ..] => "a bzip2 file: unpack it (bunzip2)",
        [b'M', b'A', b'T', b'L', b'A', b'B', ..] => "a MATLAB file: write its arrays as run.csv",
        [b'U', b'L', b'o', b'g', ..] => "a ULog of PX4: convert it (ulog2csv)",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_others_are_named() {
        let zip = |member: &str| [b"PK\x03\x04....", member.as_bytes()].concat();
        for (head, word) in [
            (zip("policy/data.pkl"), "ONNX"),
            (zip("joint_pos.npy"), "NumPy archive"),
            (zip("a.txt"), "ZIP"),
            (b"\x93NUMPY\x01".to_vec(), ".npy"),
            (b"\x89HDF\r\n".to_vec(), "HDF5"),
            (vec![0x80, 4, 0x95], "pickle"),
            (vec![0x1f, 0x8b, 8], "gzip"),
        ] {
            assert!(named(&head).is_some_and(|what| what.contains(word)), "{word}");
        }
        assert_eq!(named(b"time,pos.a"), None);
        assert_eq!(named(b""), None);
    }
}
