//! Asking a language model for priors of friction: one request to an OpenAI-compatible endpoint, only when a user names one.

use qv_contact::{ContactError, prior};
use std::time::Duration;

/// Environment variable of the key that is sent as a bearer token.
pub const KEY: &str = "QV_API_KEY";
/// Longest that an answer may take.
const PATIENCE: Duration = Duration::from_secs(120);
/// Longest answer that is read \[bytes\].
const LONGEST: u64 = 1 << 20;

/// The model's answer about `labels`, as text.
///
/// # Errors
/// When the endpoint cannot be reached, refuses, or answers something else.
pub fn ask(url: &str, model: &str, labels: &[String]) -> Result<String, ContactError> {
    let failed =
        |found: String| ContactError::Prior { file: url.into(), expected: "an answer of a model".into(), found };
    let key = std::env::var(KEY).ok();
    may_be_sent(url, key.is_some()).map_err(failed)?;
    let url = format!("{}/chat/completions", url.trim_end_matches('/').trim_end_matches("/chat/completions"));
    let config = ureq::Agent::config_builder().timeout_global(Some(PATIENCE)).http_status_as_error(false).build();
    let mut request = ureq::Agent::new_with_config(config).post(&url).header("content-type", "application/json");
    if let Some(key) = key {
        request = request.header("authorization", format!("Bearer {key}"));
    }
    let body = prior::request(model, labels).to_string();
    let mut response = request.send(body.as_bytes()).map_err(|e| failed(e.to_string()))?;
    let status = response.status();
    let text = response.body_mut().with_config().limit(LONGEST).read_to_string().map_err(|e| failed(e.to_string()))?;
    if !status.is_success() {
        let short: String = text.chars().take(200).collect();
        return Err(failed(format!("status {status}: {short}")));
    }
    prior::answer_of(&text)
}

/// Whether a request may go to an address; a key goes by TLS, or stays on this machine.
fn may_be_sent(url: &str, with_key: bool) -> Result<(), String> {
    if url.starts_with("https://") {
        let lacks = "https://, for which qv must be built with the feature tls";
        return if cfg!(feature = "tls") { Ok(()) } else { Err(lacks.into()) };
    }
    let Some(rest) = url.strip_prefix("http://") else {
        return Err("an address that starts neither with https:// nor with http://".into());
    };
    let host = rest.split(['/', '?', '#']).next().unwrap_or("");
    // What comes before an `@` is a user's name, which may look like a host.
    let host = host.rsplit('@').next().unwrap_or("");
    let is_here =
        host == "localhost" || host.starts_with("localhost:") || host.starts_with("[::1]") || is_loopback(host);
    if with_key && !is_here {
        return Err(format!("http:// with a key in {KEY}: a key goes to other machines by https:// only"));
    }
    Ok(())
}

fn is_loopback(host: &str) -> bool {
    host.split(':').next().and_then(|h| h.parse::<std::net::Ipv4Addr>().ok()).is_some_and(|a| a.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use std::io::{Read, Write};
    use std::net::TcpListener;

    /// A server that answers one request and returns what it was sent.
    fn server(status: &'static str, body: &'static str) -> (String, std::thread::JoinHandle<String>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}/v1", listener.local_addr().unwrap());
        let serving = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut seen, mut buffer) = (Vec::new(), [0u8; 4096]);
            // The request ends with the JSON body's closing braces.
            while !String::from_utf8_lossy(&seen).trim_end().ends_with("}]}") && !is_whole(&seen) {
                let n = stream.read(&mut buffer).unwrap();
                assert!(n > 0, "the request was cut off");
                seen.extend_from_slice(&buffer[..n]);
            }
            let head = format!("HTTP/1.1 {status}\r\ncontent-length: {}\r\nconnection: close\r\n\r\n", body.len());
            stream.write_all((head + body).as_bytes()).unwrap();
            String::from_utf8(seen).unwrap()
        });
        (address, serving)
    }

    fn is_whole(seen: &[u8]) -> bool {
        let text = String::from_utf8_lossy(seen).to_lowercase();
        let Some((head, body)) = text.split_once("\r\n\r\n") else { return false };
        let length = head.lines().find_map(|l| l.strip_prefix("content-length: ")?.trim().parse::<usize>().ok());
        length.is_some_and(|n| body.len() >= n)
    }

    #[test]
    fn a_model_answers() {
        let (url, serving) = server(
            "200 OK",
            r#"{"choices":[{"message":{"role":"assistant","content":"{\"ice\": {\"mean\": 0.1, \"sd\": 0.04}}"}}]}"#,
        );
        let labels = vec!["ice".to_string()];
        let answer = ask(&url, "tiny", &labels).unwrap();
        let seen = serving.join().unwrap();
        assert!(seen.starts_with("POST /v1/chat/completions") && seen.contains("\"tiny\""), "{seen}");
        let table = prior::from_table(&labels, &prior::built_in()).unwrap();
        assert_eq!(prior::from_answer(&answer, "answer", table).unwrap()[0].mean, 0.1);
    }

    #[test]
    fn a_key_leaves_the_machine_by_tls_only() {
        for here in ["http://localhost:8080/v1", "http://127.0.0.1:1/v1", "http://[::1]:8080", "http://127.9.9.9"] {
            assert!(may_be_sent(here, true).is_ok(), "{here}");
        }
        for away in ["http://localhost.example.org/v1", "http://127.0.0.1@example.org/v1", "http://10.0.0.1/v1"] {
            assert!(may_be_sent(away, true).unwrap_err().contains("https"), "{away}");
            assert!(may_be_sent(away, false).is_ok(), "{away}");
        }
        assert!(may_be_sent("https://example.org/v1", true).is_ok());
    }

    #[test]
    fn refusals_and_wrong_addresses_are_named() {
        let (url, serving) = server("401 Unauthorized", "no key");
        let error = ask(&url, "tiny", &["ice".into()]).unwrap_err().to_string();
        serving.join().unwrap();
        assert!(error.contains("401") && error.states("key"), "{error}");
        let (url, serving) = server("200 OK", "<html>hello</html>");
        let error = ask(&url, "tiny", &["ice".into()]).unwrap_err().to_string();
        serving.join().unwrap();
        assert!(error.contains("choices[0]"), "{error}");
        assert!(ask("ftp://example.org/v1", "tiny", &[]).unwrap_err().to_string().contains("https://"));
        assert!(ask("http://127.0.0.1:9/v1", "tiny", &[]).is_err(), "nobody listens there");
    }
}
