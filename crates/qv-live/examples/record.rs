//! Messages as a robot sends them, counted and recorded; what is no message of its type is left out.

use qv_go2::messages::{LowState, encode_low_state};
use qv_live::{Health, Recorder, Sample, subscriptions};
use std::io::Cursor;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot = qv_recording::robots::built_in("go2").ok_or("a robot of that name")?;
    let all = subscriptions(&robot.mapping, &[])?;
    let subscription = all.iter().position(|s| s.topic == "/lowstate").ok_or("its low state")?;
    let (mut health, mut recorder) = (Health::new(&all)?, Recorder::new(Cursor::new(Vec::new()), &all)?);
    for k in 0..500_u32 {
        let mut data = encode_low_state(&LowState { tick: 2 * k, ..Default::default() });
        if k == 100 {
            data.truncate(20);
        }
        let received = 1_700_000_000_000_000_000 + 2_000_000 * u64::from(k);
        let sample = Sample { subscription, received, sent: None, writer: 1, sequence: i64::from(k), data };
        if health.count(&sample) {
            recorder.write(&sample)?;
        }
    }
    let (topic, file) = (&health.topics[subscription], recorder.finish()?.into_inner());
    println!("{} messages, {} refused, {} bytes", topic.messages, topic.garbage, file.len());
    assert_eq!((topic.messages, topic.garbage, topic.lost), (499, 1, 0));
    Ok(())
}
