//! Stamps of messages that came in bursts, as over Wi-Fi: put back where they were sent.

use crate::run::Clock;

/// Messages that show bursts, at least.
const LEAST: usize = 60;
/// An interval below this share of the mean one is within a burst; so many of all must be.
const CLOSE: f64 = 0.2;
const OFTEN: f64 = 0.6;
/// A pause of this many bursts is a gap, across which nothing is evened out.
const GAP: f64 = 10.0;
/// Rates that clocks of robots have \[Hz\]; a fitted one this near is taken for it.
const RATES: [f64; 12] = [1000.0, 500.0, 400.0, 333.333_333, 250.0, 200.0, 125.0, 100.0, 60.0, 50.0, 30.0, 25.0];
const NEAR: f64 = 0.015;

/// What messages say of the time of their sender, one number per message each.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Sender {
    /// When it sent them by the file (MCAP's `publish_time`) \[ns\]; when they were logged where it does not know.
    pub sent: Vec<i64>,
    /// Its count of milliseconds in each message; empty where messages have none.
    pub ticks: Vec<f64>,
}

/// How stamps of bursts were put where messages were sent.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EvenStamps {
    /// In words, for a remark.
    pub how: String,
    /// The sender's clock, where there is one.
    pub clock: Option<Clock>,
}

/// Puts stamps \[ns\] where messages that came in bursts were sent, and says how: by the time of their sender where there is one, else on even times.
/// The last message of a burst is the least delayed, so that the line through those is where all were sent.
pub(crate) fn even_out(stamps: &mut [i64], sender: &Sender) -> Option<EvenStamps> {
    if stamps.len() < LEAST || stamps.windows(2).any(|w| w[1] < w[0]) {
        return None;
    }
    let mean = (stamps[stamps.len() - 1] - stamps[0]) as f64 / (stamps.len() - 1) as f64;
    let ends: Vec<usize> =
        (1..stamps.len()).filter(|&i| (stamps[i] - stamps[i - 1]) as f64 > CLOSE * mean).map(|i| i - 1).collect();
    let within = stamps.len() - 1 - ends.len();
    if (within as f64) < OFTEN * (stamps.len() - 1) as f64 || ends.len() < 5 {
        return None;
    }
    let burst = (stamps[stamps.len() - 1] - stamps[0]) as f64 / ends.len() as f64;
    let came = format!(
        "messages came in bursts of {:.0} every {:.0} ms",
        stamps.len() as f64 / ends.len() as f64,
        1e-6 * burst
    );
    let ticks: Vec<i64> = sender.ticks.iter().map(|tick| (1e6 * tick) as i64).collect();
    for (times, name, clock) in [(&sender.sent, "`publish_time`", Clock::Published), (&ticks, "`tick`", Clock::Tick)] {
        if let Some(sent) = sent_at(stamps, times) {
            stamps.copy_from_slice(&sent);
            let how = format!("{came}: their times are those of the sender's {name}");
            return Some(EvenStamps { how, clock: Some(clock) });
        }
    }
    let mut start = 0;
    let breaks: Vec<usize> =
        (1..stamps.len()).filter(|&i| (stamps[i] - stamps[i - 1]) as f64 > GAP * burst).chain([stamps.len()]).collect();
    for end in breaks {
        even(&mut stamps[start..end], start, &ends);
        start = end;
    }
    Some(EvenStamps { how: format!("{came}: their stamps are evened out"), clock: None })
}

/// When messages were sent by a clock of their sender, on the clock of their stamps \[ns\]; `None` where it is no clock of its own: each message has
/// its time, they are no bursts, and it runs no faster or slower than stamps do. Messages of a burst may be logged in another order than they were
/// sent in.
fn sent_at(stamps: &[i64], clock: &[i64]) -> Option<Vec<i64>> {
    let mut sorted = clock.to_vec();
    sorted.sort_unstable();
    if clock.len() != stamps.len() || clock == stamps || sorted.windows(2).any(|w| w[1] <= w[0]) {
        return None;
    }
    let span = (stamps[stamps.len() - 1] - stamps[0]) as f64;
    let counted = (sorted[sorted.len() - 1] - sorted[0]) as f64;
    let mean = counted / (sorted.len() - 1) as f64;
    let close = sorted.windows(2).filter(|w| ((w[1] - w[0]) as f64) < CLOSE * mean).count();
    if (counted / span - 1.0).abs() > NEAR || close as f64 > OFTEN * (sorted.len() - 1) as f64 {
        return None;
    }
    // No message came before it was sent.
    let start = (0..stamps.len()).map(|i| stamps[i] - clock[i]).min()?;
    Some(clock.iter().map(|time| start + time).collect())
}

/// The line through the ends of bursts, of a piece without gaps that begins at `first`.
fn even(stamps: &mut [i64], first: usize, ends: &[usize]) {
    let inside: Vec<usize> = ends.iter().filter_map(|i| i.checked_sub(first)).filter(|i| *i < stamps.len()).collect();
    if inside.len() < 3 {
        return;
    }
    let (origin, count) = (stamps[0], inside.len() as f64);
    let y = |i: usize| (stamps[i] - origin) as f64;
    let (mean_x, mean_y) =
        (inside.iter().map(|i| *i as f64).sum::<f64>() / count, inside.iter().map(|i| y(*i)).sum::<f64>() / count);
    let xy: f64 = inside.iter().map(|&i| (i as f64 - mean_x) * (y(i) - mean_y)).sum();
    let xx: f64 = inside.iter().map(|&i| (i as f64 - mean_x).powi(2)).sum();
    let fitted = xy / xx;
    let usual = RATES.iter().map(|rate| 1e9 / rate).find(|period| (fitted / period - 1.0).abs() < NEAR);
    let period = usual.unwrap_or(fitted);
    // No message came before it was sent.
    let start = inside.iter().map(|&i| y(i) - period * i as f64).fold(f64::INFINITY, f64::min);
    stamps.iter_mut().enumerate().for_each(|(i, stamp)| *stamp = origin + (start + period * i as f64) as i64);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages every 2 ms that are logged every `burst` ms, in the order that they were sent.
    fn logged(burst: i64) -> Vec<i64> {
        (0..1000)
            .map(|i| 2 * i)
            .map(|ms| (ms + burst - 1) / burst * burst * 1_000_000 + 20_000 * ((ms + burst - 2) % burst))
            .collect()
    }

    #[test]
    fn bursts_are_put_where_they_were_sent() {
        for burst in [10, 20, 60] {
            let mut stamps = logged(burst);
            let said = even_out(&mut stamps, &Sender::default()).unwrap();
            assert!(said.how.contains("bursts") && said.clock.is_none(), "{said:?}");
            let late = |i: usize| (stamps[i] - 2_000_000 * i as i64).abs();
            assert!((0..1000).all(|i| late(i) < 1_500_000), "{burst} {:?}", (0..1000).map(late).max());
        }
    }

    #[test]
    fn even_and_jittered_stamps_stay() {
        let mut jittered: Vec<i64> = (0..1000).map(|i| 2_000_000 * i + (i * 7919 % 13) * 60_000).collect();
        let before = jittered.clone();
        assert_eq!((even_out(&mut jittered, &Sender::default()), jittered), (None, before));
    }

    /// A clock of the sender shows what was lost between bursts, which even times do not; one that stands still is no clock.
    #[test]
    fn the_time_of_the_sender_is_taken_where_there_is_one() {
        let kept: Vec<usize> = (0..1000).filter(|i| i % 7 != 3 || *i < 300).collect();
        let all = logged(20);
        let before: Vec<i64> = kept.iter().map(|&i| all[i]).collect();
        let ticks: Vec<f64> = kept.iter().map(|&i| 5000.0 + 2.0 * i as f64).collect();
        let sent: Vec<i64> = kept.iter().map(|&i| 7_000_000_000 + 2_000_000 * i as i64).collect();
        let by_tick = Sender { ticks: ticks.clone(), sent: before.clone() };
        let by_file = Sender { ticks: Vec::new(), sent };
        for (sender, name, clock) in [(by_tick, "tick", Clock::Tick), (by_file, "publish_time", Clock::Published)] {
            let mut stamps = before.clone();
            let evened = even_out(&mut stamps, &sender).unwrap();
            assert!(evened.how.contains(name) && evened.clock == Some(clock));
            let late = |k: usize| (stamps[k] - 2_000_000 * kept[k] as i64).abs();
            assert!((0..kept.len()).all(|k| late(k) < 1_500_000), "{:?}", (0..kept.len()).map(late).max());
            // A burst whose messages are logged the other way round.
            let mut of_turned = sender.clone();
            if sender.ticks.is_empty() {
                of_turned.sent[1..11].reverse()
            } else {
                of_turned.ticks[1..11].reverse()
            }
            let mut turned = before.clone();
            even_out(&mut turned, &of_turned).unwrap();
            assert_eq!(turned[1] - turned[10], stamps[10] - stamps[1]);
        }
        let still = Sender { ticks: vec![7.0; kept.len()], sent: before.clone() };
        let mut without = before;
        assert!(even_out(&mut without, &still).unwrap().how.contains("evened"));
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let mut stamps = logged(20);
        stamps[500..].iter_mut().for_each(|s| *s += 3_000_000_000);
        even_out(&mut stamps, &Sender::default()).unwrap();
        assert!((stamps[500] - stamps[499] - 3_002_000_000).abs() < 21_000_000);
    }
}
