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
    if !url.starts_with("http://") {
        return Err(failed(
            "an address that does not start with http:// (TLS is not built in: use a local server)".into(),
        ));
    }
    let url = format!("{}/chat/completions", url.trim_end_matches('/').trim_end_matches("/chat/completions"));
    let config = ureq::Agent::config_builder().timeout_global(Some(PATIENCE)).http_status_as_error(false).build();
    let mut request = ureq::Agent::new_with_config(config).post(&url).header("content-type", "application/json");
    if let Ok(key) = std::env::var(KEY) {
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

#[cfg(test)]
mod tests {
    use super::*;
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
    fn refusals_and_wrong_addresses_are_named() {
        let (url, serving) = server("401 Unauthorized", "no key");
        let error = ask(&url, "tiny", &["ice".into()]).unwrap_err().to_string();
        serving.join().unwrap();
        assert!(error.contains("401") && error.contains("no key"), "{error}");
        let (url, serving) = server("200 OK", "<html>hello</html>");
        let error = ask(&url, "tiny", &["ice".into()]).unwrap_err().to_string();
        serving.join().unwrap();
        assert!(error.contains("choices[0]"), "{error}");
        assert!(ask("https://example.org/v1", "tiny", &[]).unwrap_err().to_string().contains("http://"));
        assert!(ask("http://127.0.0.1:9/v1", "tiny", &[]).is_err(), "nobody listens there");
    }
}
