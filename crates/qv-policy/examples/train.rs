//! Trains the Go2 to walk, and prints how it goes.
use qv_policy::env::VectorEnv;
use qv_policy::ppo::{Ppo, PpoSettings};
use qv_policy::velocity::*;
use std::time::Instant;

fn robot() -> TaskRobot {
    qv_go2::walk::robot().unwrap()
}

fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/self/stat").unwrap();
    let f: Vec<&str> = s.rsplit(')').next().unwrap().split_whitespace().collect();
    (f[11].parse::<f64>().unwrap() + f[12].parse::<f64>().unwrap()) / 100.0
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let seed: u64 = args[1].parse().unwrap();
    let count: usize = args[2].parse().unwrap();
    let iterations: usize = args[3].parse().unwrap();
    let threads: usize = args[4].parse().unwrap();
    let mut settings = TaskSettings::default();
    let mut ppo_settings = PpoSettings::default();
    if let Some(text) = args.get(5) {
        settings = toml::from_str(text).unwrap();
    }
    if let Some(text) = args.get(6) {
        ppo_settings = toml::from_str(text).unwrap();
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let robot = robot();
        eprintln!("height {} torque {}", robot.height, robot.torque_scale());
        let mut env = VelocityTask::new(robot.clone(), Ground::plane(), settings.clone(), count).unwrap();
        let mut judge = VelocityTask::new(robot, Ground::plane(), settings.clone(), 64).unwrap();
        env.restart(seed, 0).unwrap();
        let mut ppo = Ppo::new(&ppo_settings, &env, seed).unwrap();
        ppo.reseed(seed, 0, count);
        let begin = Instant::now();
        let start = cpu();
        let mut scoring = 0.0;
        for k in 0..iterations {
            let it = ppo.iterate(&mut env).unwrap();
            if (k + 1) % 20 == 0 {
                let figures = env.figures();
                let c0 = cpu();
                let s = qv_policy::score::score(&qv_policy::policy::Policy::of(&ppo), &mut judge, &settings.commands, 6.0, 7).unwrap();
                scoring += cpu() - c0;
                println!("{k} {:.2}M wall {:.1} cpu {:.1} (score {:.1}) r {:.4} std {:.2} kl {:.4} lr {:.1e} ev {:.2} ends {:?} | fell {} v {:.3} w {:.3} swing {:.3}s {:.1}cm",
                    ((k + 1) * count * 24) as f64 / 1e6, begin.elapsed().as_secs_f64(), cpu() - start - scoring, scoring, it.reward, it.std, it.divergence, it.rate, it.explained, it.ends,
                    s.fell, s.velocity_error, s.turning_error, s.swing_time, s.swing_height * 100.0);
                if std::env::var("TERMS").is_ok() { println!("   {}", figures.iter().map(|(n, x)| format!("{n} {x:.3}")).collect::<Vec<_>>().join(" ")); }
            }
        }
    });
}
