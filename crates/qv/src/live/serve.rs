//! One page over HTTP on the loopback interface alone: nobody else on the network of the robot sees it.

use std::io::{self, BufRead, BufReader, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// Seconds after which a browser asks again.
const REFRESH: u32 = 2;
/// Longest first line of a request, and longest wait for it.
const LINE: u64 = 8192;
const PATIENCE: Duration = Duration::from_secs(2);

/// What the page shows now.
pub type PageText = Arc<Mutex<String>>;

/// Serves `shown` from a thread of its own. Returns the address.
///
/// # Errors
/// The port is taken.
pub fn serve(port: u16, shown: PageText) -> io::Result<SocketAddr> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
    let address = listener.local_addr()?;
    thread::spawn(move || {
        // One after another: a browser or two look.
        for stream in listener.incoming().flatten() {
            _ = answer(stream, &shown);
        }
    });
    Ok(address)
}

fn answer(mut stream: TcpStream, shown: &PageText) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut line = String::new();
    io::Read::take(BufReader::new(&mut stream), LINE).read_line(&mut line)?;
    let is_page = line.starts_with("GET / ");
    let (status, body) = match is_page {
        true => ("200 OK", shown.lock().map(|text| text.clone()).unwrap_or_default()),
        false => ("404 Not Found", String::new()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: {}\r\nRefresh: {REFRESH}\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    fn ask(address: SocketAddr, words: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(words.as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn the_page_is_served_on_loopback_and_asks_again() {
        let shown: PageText = Arc::new(Mutex::new("<h1>first</h1>".into()));
        let address = serve(0, shown.clone()).unwrap();
        assert!(address.ip().is_loopback());
        let text = ask(address, "GET / HTTP/1.1\r\n\r\n");
        assert!(text.starts_with("HTTP/1.1 200") && text.contains("Refresh: 2") && text.ends_with("<h1>first</h1>"));
        *shown.lock().unwrap() = "<h1>second</h1>".into();
        assert!(ask(address, "GET / HTTP/1.1\r\n\r\n").ends_with("second</h1>"));
        assert!(ask(address, "GET /other HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
    }
}
