//! The conventions of the command channel: order of joints, sign, unit, offset, gains, stamps, and what firmware makes of commands.
//!
//! Where torques were recorded the law of the motors shows it (`law`), else the motion of the joints (`follow`). What is found is reported
//! with the line for `run.toml` that reads it so; nothing is changed until that is asked for ([`fix`]).

mod analysis;
mod follow;
mod law;
mod reading;
mod samples;
mod shape;
mod torques;
mod writers;

pub use analysis::Check;
pub(crate) use analysis::{Analysis, Finding};
pub use reading::{CommandReading, JointReading};
pub use shape::Shape;

use crate::run::{Fault, FaultKind, Run};

/// Looks at the commands of `run`.
pub(crate) fn analyse(run: &Run) -> Analysis {
    let reading = CommandReading::plain(run.joint_names.len());
    if let Some(finding) = writers::several(run) {
        let check = Check { name: "writers of commands".into(), found: finding.what.clone(), is_ours: Some(false) };
        return Analysis { findings: vec![finding], checks: vec![check], reading };
    }
    torques::analyse(run).unwrap_or_else(|| follow::analyse(run))
}

/// Faults of the command channel.
pub(crate) fn faults(run: &Run, analysis: &Analysis) -> Vec<Fault> {
    let fault = |finding: &Finding| {
        let hint = match finding.line.as_str() {
            "" => String::new(),
            line => format!("; run.toml: {line} (or --fix)"),
        };
        let detail = format!("{}{hint}", finding.what);
        Fault { kind: FaultKind::Convention, channel: finding.channel.clone(), time: run.span()[0], count: 1, detail }
    };
    analysis.findings.iter().map(fault).collect()
}

/// The run as its commands read with all that was found: for judging other channels by them.
pub(crate) fn mended(run: &Run, analysis: &Analysis) -> Option<Run> {
    (!analysis.reading.is_plain()).then(|| {
        let mut read = run.clone();
        analysis.reading.apply(&mut read);
        read
    })
}

/// Reads the commands as what was found says; the faults become remarks. Faults that no setting mends stay.
pub fn fix(mut run: Run) -> Run {
    let is_ours = |f: &Fault| f.kind == FaultKind::Convention && f.channel.starts_with("commands");
    if !run.faults.iter().any(is_ours) {
        return run;
    }
    let analysis = analyse(&run);
    analysis.reading.apply(&mut run);
    for finding in analysis.findings.iter().filter(|f| !f.line.is_empty()) {
        run.faults.retain(|f| !(is_ours(f) && f.channel == finding.channel && f.detail.starts_with(&finding.what)));
        run.remarks.push(format!("{}: {}; read so (--fix): {}", finding.channel, finding.what, finding.line));
    }
    run
}
