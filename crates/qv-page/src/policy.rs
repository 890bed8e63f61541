//! What a page may do: show itself. A browser that reads this fetches nothing, and runs no script but the page's own.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

/// The element that says so, for the head of a page before all else. `scripts` are the whole texts of the script elements that run; one
/// that came in with a name or a number is none of them.
pub fn policy(scripts: &[&str]) -> String {
    let hash = |script: &&str| format!(" 'sha256-{}'", STANDARD.encode(Sha256::digest(script.as_bytes())));
    let hashes: String = scripts.iter().map(hash).collect();
    let allowed = if hashes.is_empty() { " 'none'" } else { &hashes };
    format!(
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; base-uri 'none'; form-action 'none'; \
         img-src data:; style-src 'unsafe-inline'; script-src{allowed}\">"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn scripts_are_named_by_their_hashes() {
        assert!(policy(&[]).states("script-src"));
        // The SHA-256 of nothing.
        assert!(policy(&[""]).states("script-src 'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"));
        assert_eq!(policy(&["a", "b"]).matches("'sha256-").count(), 2);
    }
}
