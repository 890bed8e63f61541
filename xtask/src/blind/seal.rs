//! A seal on the answers: they are fixed before the first diagnosis, and shown not to have changed after the last.

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fs;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::path::Path;

/// What is written to the seal file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// Random hexadecimal digits that are hashed before the answers.
    nonce: String,
    /// SHA-256 of nonce and answers, hexadecimal.
    sha256: String,
}

impl Seal {
    /// Seals answers under a nonce of the system's randomness.
    pub fn close(answers: &str) -> Self {
        let digits = || format!("{:016x}", RandomState::new().build_hasher().finish());
        Self::with_nonce(digits() + &digits(), answers)
    }

    fn with_nonce(nonce: String, answers: &str) -> Self {
        let mut hash = Sha256::new();
        hash.update(nonce.as_bytes());
        hash.update(answers.as_bytes());
        let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        Self { nonce, sha256 }
    }

    /// Checks that these are the answers that were sealed.
    ///
    /// # Errors
    /// They are others.
    pub fn open(&self, answers: &str) -> Result<()> {
        let found = Self::with_nonce(self.nonce.clone(), answers).sha256;
        if found != self.sha256 {
            bail!("seal: expected answers of SHA-256 {}, found {found}", self.sha256);
        }
        Ok(())
    }

    /// Writes the seal; one that is there already must fit, since reports may have been made under it.
    ///
    /// # Errors
    /// The file cannot be read or written, or seals other answers.
    pub fn place(answers: &str, file: &Path) -> Result<Self> {
        if let Ok(text) = fs::read_to_string(file) {
            let seal: Self = serde_json::from_str(&text).with_context(|| format!("in {}", file.display()))?;
            seal.open(answers).with_context(|| format!("{}: answers of an earlier run", file.display()))?;
            return Ok(seal);
        }
        let seal = Self::close(answers);
        fs::write(file, serde_json::to_string_pretty(&seal)? + "\n")
            .with_context(|| format!("writing {}", file.display()))?;
        Ok(seal)
    }

    /// The hash.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_opens_for_the_sealed_answers_alone() {
        let seal = Seal::close("payload_mass 2.5 kg");
        assert!(seal.open("payload_mass 2.5 kg").is_ok());
        let error = seal.open("payload_mass 2.6 kg").unwrap_err().to_string();
        assert!(error.contains(seal.sha256()), "{error}");
        assert_ne!(seal, Seal::close("payload_mass 2.5 kg"), "each seal has a nonce of its own");
    }

    #[test]
    fn the_hash_is_sha_256_of_nonce_and_answers() {
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(Seal::with_nonce("a".into(), "bc").sha256, expected);
    }

    #[test]
    fn a_seal_in_place_is_kept_and_must_fit() {
        let folder = std::env::temp_dir().join(format!("qv-seal-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let file = folder.join("seal.json");
        let first = Seal::place("answers", &file).unwrap();
        assert_eq!(Seal::place("answers", &file).unwrap(), first);
        assert!(Seal::place("other answers", &file).is_err());
        fs::remove_dir_all(&folder).unwrap();
    }
}
