//! A policy in ONNX runs in a process of its own, within limits of memory and time: its file may be anybody's, and what a graph takes is
//! known only when it runs.
//!
//! Both sides speak in messages: one byte, 0 for what was asked for and 1 for the words of an error, the number of parts, and each
//! part after its length; all numbers are little-endian.

use crate::Failure;
use crate::open::file_error;
use qv_policy::onnx::reader::{ReadModel, Step, TensorInfo};
use qv_policy::onnx::{OnnxError, OnnxPolicy};
use qv_recording::RecordingError;
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use std::fs;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout};
#[cfg(not(test))]
use std::process::{Command, Stdio};

/// The word by which this program becomes such a process.
const WORD: &str = "run-policy-child";
/// Addresses that a model may take \[bytes\], and for each byte of its file.
const MEMORY: u64 = 1 << 30;
const MEMORY_OF_BYTE: u64 = 8;
/// Processor time of loading, and of each step \[s\].
const SECONDS: u64 = 3;
/// Largest part of a message \[bytes\].
const LARGEST: u64 = 1 << 32;
/// Most parts of a message.
const MOST: u64 = 1 << 16;

/// Inputs and outputs of a model.
#[derive(Serialize, Deserialize)]
struct Signature {
    inputs: Vec<TensorInfo>,
    outputs: Vec<TensorInfo>,
}

/// The policy of a file, with the weights that lie in files beside it.
///
/// # Errors
/// There is no such file, or none beside it that it names; else as [`OnnxPolicy::from_bytes`], and where the model takes too much memory or
/// time.
pub fn policy_at(path: &Path) -> Result<OnnxPolicy, RecordingError> {
    let wrong = |found: String| file_error(path, "a policy in ONNX", &found);
    let bytes = fs::read(path).map_err(|e| wrong(e.to_string()))?;
    if let Some(what) = qv_open::unread::named(&bytes[..bytes.len().min(qv_open::unread::HEAD)]) {
        return Err(wrong(what.to_string()));
    }
    let names = qv_policy::onnx::external_files(&bytes).map_err(|e| wrong(e.to_string()))?;
    let mut files = Vec::new();
    for name in names {
        // A file of anybody names no other than those in its own folder.
        if Path::new(&name).file_name().is_none_or(|own| own != name.as_str()) {
            return Err(wrong(format!("weights in `{name}`, which is not beside it")));
        }
        let ending = Path::new(&name).extension().and_then(OsStr::to_str).unwrap_or_default();
        if !(ending.starts_with("data") || ending.starts_with("onnx_data")) {
            let how = "export it with weights in a file that ends in .data or .onnx_data, or within the model";
            return Err(wrong(format!("weights in `{name}`: {how}")));
        }
        let beside = path.with_file_name(&name);
        let missing = |e: io::Error| file_error(&beside, &format!("the weights of {}", path.display()), &e.to_string());
        files.push((name, fs::read(&beside).map_err(missing)?));
    }
    policy(&bytes, &files).map_err(|e| wrong(e.to_string()))
}

/// A policy that runs in a process of its own.
#[cfg(not(test))]
fn policy(bytes: &[u8], files: &[(String, Vec<u8>)]) -> Result<OnnxPolicy, OnnxError> {
    let failed = |e: io::Error| OnnxError::Load(format!("no process to run it in: {e}"));
    let program = std::env::current_exe().map_err(failed)?;
    let mut command = Command::new(program);
    command.arg(WORD).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    // Ctrl-C is for the parent to follow; without it this process ends at the end of its input.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn().map_err(failed)?;
    let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(OnnxError::Load("no pipe to the process that runs it".into()));
    };
    let mut elsewhere = Elsewhere { child, input: BufWriter::new(input), output: BufReader::new(output) };
    let beside = files.iter().flat_map(|(name, contents)| [name.as_bytes(), contents.as_slice()]);
    let parts: Vec<&[u8]> = [bytes].into_iter().chain(beside).collect();
    let said = elsewhere.ask(&parts).map_err(OnnxError::Load)?;
    let signature: Signature = said
        .first()
        .and_then(|text| serde_json::from_slice(text).ok())
        .ok_or_else(|| OnnxError::Load("no inputs and outputs".into()))?;
    OnnxPolicy::of(Box::new(elsewhere), signature.inputs, signature.outputs)
}

/// The program of a test is no other than itself.
#[cfg(test)]
fn policy(bytes: &[u8], files: &[(String, Vec<u8>)]) -> Result<OnnxPolicy, OnnxError> {
    let model = ReadModel::with_files(bytes, files)?;
    let (inputs, outputs) = (model.inputs().to_vec(), model.outputs().to_vec());
    OnnxPolicy::of(Box::new(model), inputs, outputs)
}

/// The process, as its parent has it.
#[cfg_attr(test, allow(dead_code))]
struct Elsewhere {
    child: Child,
    input: BufWriter<ChildStdin>,
    output: BufReader<ChildStdout>,
}

#[cfg_attr(test, allow(dead_code))]
impl Elsewhere {
    fn ask(&mut self, parts: &[&[u8]]) -> Result<Vec<Vec<u8>>, String> {
        let answer = send(&mut self.input, 0, parts).and_then(|()| receive(&mut self.output));
        match answer {
            Ok((0, parts)) => Ok(parts),
            Ok((_, parts)) => Err(String::from_utf8_lossy(&parts.concat()).into_owned()),
            Err(_) => Err(self.ended()),
        }
    }

    /// Why it says nothing more.
    fn ended(&mut self) -> String {
        _ = self.child.kill();
        let how = self.child.wait().map_or_else(|e| e.to_string(), |status| status.to_string());
        format!("a model that takes more than {} MiB of memory or {SECONDS} s of processor time ({how})", MEMORY >> 20)
    }
}

impl Step for Elsewhere {
    fn step(&mut self, inputs: &[&[f32]]) -> Result<Vec<Vec<f32>>, OnnxError> {
        let parts: Vec<Vec<u8>> = inputs.iter().map(|numbers| to_bytes(numbers)).collect();
        let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
        let answer = self.ask(&parts).map_err(OnnxError::Run)?;
        Ok(answer.iter().map(|part| to_numbers(part)).collect())
    }
}

impl Drop for Elsewhere {
    fn drop(&mut self) {
        _ = self.child.kill();
        _ = self.child.wait();
    }
}

/// Whether this process is one that runs a policy.
pub fn is_child() -> bool {
    std::env::args_os().nth(1).is_some_and(|word| word == OsStr::new(WORD)) && std::env::args_os().len() == 2
}

/// Runs the policy that comes on standard input, until nobody asks any more.
///
/// # Errors
/// The parent is gone.
pub fn serve() -> Result<(), Failure> {
    let (mut input, mut output) = (BufReader::new(io::stdin().lock()), BufWriter::new(io::stdout().lock()));
    let (_, mut parts) = receive(&mut input)?;
    let bytes: usize = parts.iter().map(Vec::len).sum();
    let beside = if parts.is_empty() { Vec::new() } else { parts.split_off(1) };
    let model = parts.concat();
    let files: Vec<(String, Vec<u8>)> =
        beside.chunks_exact(2).map(|pair| (String::from_utf8_lossy(&pair[0]).into_owned(), pair[1].clone())).collect();
    limit_memory(MEMORY + MEMORY_OF_BYTE * bytes as u64)?;
    limit_time()?;
    let mut loaded = match ReadModel::with_files(&model, &files) {
        Ok(loaded) => loaded,
        Err(error) => return Ok(send(&mut output, 1, &[reason(&error).as_bytes()])?),
    };
    let (inputs, outputs) = (loaded.inputs().to_vec(), loaded.outputs().to_vec());
    let signature = serde_json::to_vec(&Signature { inputs, outputs })?;
    send(&mut output, 0, &[&signature])?;
    loop {
        let Ok((_, parts)) = receive(&mut input) else { return Ok(()) };
        limit_time()?;
        let given: Vec<Vec<f32>> = parts.iter().map(|part| to_numbers(part)).collect();
        let given: Vec<&[f32]> = given.iter().map(Vec::as_slice).collect();
        match loaded.step(&given) {
            Ok(answer) => {
                let answer: Vec<Vec<u8>> = answer.iter().map(|numbers| to_bytes(numbers)).collect();
                let answer: Vec<&[u8]> = answer.iter().map(Vec::as_slice).collect();
                send(&mut output, 0, &answer)?;
            }
            Err(error) => send(&mut output, 1, &[reason(&error).as_bytes()])?,
        }
    }
}

/// What the parent puts into an error of the same kind.
fn reason(error: &OnnxError) -> String {
    match error {
        OnnxError::Load(reason) | OnnxError::Run(reason) => reason.clone(),
        other => other.to_string(),
    }
}

#[cfg(unix)]
fn limit_memory(bytes: u64) -> io::Result<()> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    // No more than the caller's own limit, if there is one.
    let most = Some(bytes.min(getrlimit(Resource::As).maximum.unwrap_or(u64::MAX)));
    Ok(setrlimit(Resource::As, Rlimit { current: most, maximum: most })?)
}

/// Gives the process [`SECONDS`] more than it took so far.
#[cfg(unix)]
fn limit_time() -> io::Result<()> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let so_far = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime).tv_sec.unsigned_abs();
    let maximum = getrlimit(Resource::Cpu).maximum;
    let current = Some((so_far + SECONDS).min(maximum.unwrap_or(u64::MAX)));
    Ok(setrlimit(Resource::Cpu, Rlimit { current, maximum })?)
}

#[cfg(not(unix))]
fn limit_memory(_: u64) -> io::Result<()> {
    Ok(())
}

#[cfg(not(unix))]
fn limit_time() -> io::Result<()> {
    Ok(())
}

fn send(to: &mut impl Write, kind: u8, parts: &[&[u8]]) -> io::Result<()> {
    to.write_all(&[kind])?;
    to.write_all(&(parts.len() as u64).to_le_bytes())?;
    for part in parts {
        to.write_all(&(part.len() as u64).to_le_bytes())?;
        to.write_all(part)?;
    }
    to.flush()
}

fn receive(from: &mut impl Read) -> io::Result<(u8, Vec<Vec<u8>>)> {
    let mut kind = [0];
    from.read_exact(&mut kind)?;
    let count = length(from, MOST)?;
    let mut parts = Vec::new();
    for _ in 0..count {
        let size = length(from, LARGEST)?;
        let mut part = Vec::new();
        // `take` grows by what really comes, never by what is claimed.
        if from.by_ref().take(size).read_to_end(&mut part)? as u64 != size {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        parts.push(part);
    }
    Ok((kind[0], parts))
}

fn length(from: &mut impl Read, most: u64) -> io::Result<u64> {
    let mut bytes = [0; 8];
    from.read_exact(&mut bytes)?;
    let length = u64::from_le_bytes(bytes);
    if length > most { Err(io::ErrorKind::InvalidData.into()) } else { Ok(length) }
}

fn to_bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn to_numbers(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_back_whole_and_cut_ones_are_errors() {
        let mut bytes = Vec::new();
        send(&mut bytes, 1, &[b"abc", b"", &to_bytes(&[1.5, -2.0])]).unwrap();
        let (kind, parts) = receive(&mut bytes.as_slice()).unwrap();
        assert_eq!((kind, parts[0].as_slice(), parts.len()), (1, &b"abc"[..], 3));
        assert_eq!(to_numbers(&parts[2]), [1.5, -2.0]);
        assert!((0..bytes.len()).all(|n| receive(&mut &bytes[..n]).is_err()));
        bytes[1..9].fill(0xff);
        assert!(receive(&mut bytes.as_slice()).is_err());
    }
}
