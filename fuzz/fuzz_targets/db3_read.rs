//! Bags in sqlite3.
#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_recording::robots::told_by_messages;
use qv_recording::{BagFile, read_bag_of};

fuzz_target!(|data: &[u8]| {
    // The magic is given, so that the time goes into what follows it.
    let mut bytes = data.to_vec();
    let magic = b"SQLite format 3\0";
    let given = magic.len().min(bytes.len());
    bytes[..given].copy_from_slice(&magic[..given]);
    if let Ok(run) =
        read_bag_of([BagFile { name: "fuzz.db3".into(), source: bytes.as_slice() }], &told_by_messages(), None)
    {
        let position = run.measured.position.expect("a run has positions");
        assert!(position.time.windows(2).all(|w| w[1] > w[0]));
    }
});
