//! Scripts that give the units of a plan to a cluster.

use crate::plan::Plan;
use std::fmt::Write;

/// What a cluster is asked for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Resources {
    /// Memory of a unit \[MiB\].
    pub memory: Option<u64>,
    /// Time of a unit \[s\].
    pub timeout: Option<f64>,
    /// How often a unit is started again.
    pub retries: u32,
    /// Processors of a unit.
    pub cpus: u32,
}

/// What the scheduler gives beyond the limits of a unit, so that `qv` says why it ended and not the scheduler \[MiB, s\].
const MARGIN: (u64, f64) = (256, 60.0);

/// Text as one word of a shell.
fn word(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// The words of `qv fleet run` that state the limits.
fn limits(resources: &Resources) -> String {
    let mut text = String::new();
    if let Some(memory) = resources.memory {
        let _ = write!(text, " --memory {memory}");
    }
    if let Some(timeout) = resources.timeout {
        let _ = write!(text, " --timeout {timeout}");
    }
    if resources.retries > 0 {
        let _ = write!(text, " --retries {}", resources.retries);
    }
    text
}

/// A job array for Slurm: `each` units a task, `program` and `folder` as they are seen from there.
pub fn slurm(plan: &Plan, program: &str, folder: &str, each: usize, resources: &Resources) -> String {
    let each = each.max(1);
    let last = plan.units.len().div_ceil(each).saturating_sub(1);
    let mut text = format!("#!/bin/bash\n#SBATCH --job-name=qv-fleet\n#SBATCH --array=0-{last}\n");
    let _ = writeln!(text, "#SBATCH --cpus-per-task={}", resources.cpus.max(1));
    if let Some(memory) = resources.memory {
        let _ = writeln!(text, "#SBATCH --mem={}M", memory + MARGIN.0);
    }
    if let Some(timeout) = resources.timeout {
        let all = (timeout * f64::from(1 + resources.retries) + MARGIN.1) * each as f64;
        let _ = writeln!(text, "#SBATCH --time={}", (all / 60.0).ceil());
    }
    let _ = writeln!(text, "# {} units, {each} a task. Afterwards: qv fleet gather", plan.units.len());
    let _ = writeln!(text, "export RAYON_NUM_THREADS=\"${{SLURM_CPUS_PER_TASK:-1}}\"");
    let unit = match each {
        1 => "\"$SLURM_ARRAY_TASK_ID\"".to_owned(),
        n => {
            let _ = writeln!(text, "first=$((SLURM_ARRAY_TASK_ID * {n}))");
            format!("\"$first-$((first + {}))\"", n - 1)
        }
    };
    let _ = writeln!(text, "{} fleet run {} --unit {unit}{}", word(program), word(folder), limits(resources));
    // 3 is a finding, no failure of the task.
    text + "status=$?\n[ \"$status\" -eq 3 ] && exit 0\nexit \"$status\"\n"
}

/// Text as a string of Python.
fn python(text: &str) -> String {
    serde_json::to_string(text).expect("text is plain data")
}

/// A workflow for Snakemake: a job for each unit; the summary is written at the end, also where units failed.
pub fn snakemake(plan: &Plan, program: &str, folder: &str, resources: &Resources) -> String {
    let mut text =
        String::from("# Written by `qv fleet snakemake`. Run it with: snakemake --cores N --keep-going -s FILE\n");
    let _ = writeln!(text, "UNITS = [");
    plan.units.iter().for_each(|unit| _ = writeln!(text, "    {},", python(&unit.id)));
    let _ = writeln!(text, "]\nQV = {}\nFLEET = {}\n", python(program), python(folder));
    text += "wildcard_constraints:\n    unit=\"u[0-9a-f]{16}\"\n\n";
    text += "rule all:\n    input: expand(\"{fleet}/units/{unit}/done.json\", fleet=FLEET, unit=UNITS)\n\n";
    text += "rule unit:\n    output: FLEET + \"/units/{unit}/done.json\"\n    params: qv=QV, fleet=FLEET\n";
    let _ = writeln!(text, "    threads: {}", resources.cpus.max(1));
    if let Some(memory) = resources.memory {
        let _ = writeln!(text, "    resources: mem_mb={}", memory + MARGIN.0);
    }
    let _ = writeln!(
        text,
        "    shell: \"RAYON_NUM_THREADS={{threads}} {{params.qv:q}} fleet run {{params.fleet:q}} --unit {{wildcards.unit:q}}{}\"\n\
         \x20          \" || [ $? -eq 3 ]\"\n",
        limits(resources)
    );
    for at in ["onsuccess", "onerror"] {
        let _ = writeln!(text, "{at}:\n    shell(\"{{QV:q}} fleet gather {{FLEET:q}} || [ $? -eq 3 ]\")\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use crate::plan::{InputFile, Recording, Task};

    fn plan(count: usize) -> Plan {
        let run = |k: usize| Recording {
            path: format!("r{k:02}"),
            robot: "arm".into(),
            start_ns: None,
            seconds: 1.0,
            files: vec![InputFile { path: "run.csv".into(), bytes: 1, sha256: format!("{k:064}") }],
        };
        Plan::new(Task::default(), (0..count).map(run).collect(), vec![], false)
    }

    #[test]
    fn job_arrays_reach_the_last_unit() {
        let resources = Resources { memory: Some(1000), timeout: Some(600.0), retries: 1, cpus: 4 };
        let one = slurm(&plan(10), "qv", "a 'b'", 1, &resources);
        for line in ["--array=0-9\n", "--mem=1256M\n", "--time=21\n", "--cpus-per-task=4\n"] {
            assert!(one.contains(line), "{line} {one}");
        }
        let run =
            "'qv' fleet run 'a '\\''b'\\''' --unit \"$SLURM_ARRAY_TASK_ID\" --memory 1000 --timeout 600 --retries 1\n";
        assert!(one.contains(run), "{one}");
        let four = slurm(&plan(10), "qv", "f", 4, &Resources::default());
        assert!(four.contains("--array=0-2\n") && four.states("first=$((SLURM_ARRAY_TASK_ID 4"), "{four}");
        assert!(four.contains("--unit \"$first-$((first + 3))\"\n") && !four.contains("--mem"), "{four}");
    }

    #[test]
    fn a_workflow_has_every_unit() {
        let plan = plan(3);
        let text = snakemake(&plan, "qv", "/f \"x\"", &Resources { memory: Some(100), ..Resources::default() });
        assert!(plan.units.iter().all(|unit| text.contains(&format!("\"{}\"", unit.id))));
        assert!(text.contains("--unit {wildcards.unit:q}") && text.contains("unit=\"u[0-9a-f]{16}\""), "{text}");
        assert!(text.states("FLEET \"/f \\\"x\\\"\"") && text.contains("mem_mb=356"), "{text}");
    }
}
