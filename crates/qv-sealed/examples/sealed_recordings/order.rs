//! Which recordings are asked for, in their fixed order.

use crate::Arguments;
use qv_core::random::{SplitMix64, sub_seed};
use qv_sealed::{EFFECTS, FaultRequest, Motion, WITHHELD, confusable_group};

/// One recording to make.
pub struct Order {
    /// `none`, `single`, `pair` or `withheld`.
    pub case: &'static str,
    pub wanted: FaultRequest,
    /// Which one of its kind, for taking turns.
    pub turn: usize,
    pub motion: Motion,
    /// Whether it is drawn whole: its sizes may be too small to be seen.
    pub is_of_study: bool,
}

/// All that the arguments ask for.
///
/// # Errors
/// When an effect is unknown, or nothing is asked for.
pub fn list(arguments: &Arguments) -> Result<Vec<Order>, String> {
    let all = arguments.effects.iter().any(|name| name == "all");
    let effects: Vec<String> = if all { EFFECTS.map(String::from).to_vec() } else { arguments.effects.clone() };
    if let Some(unknown) = effects.iter().find(|name| !EFFECTS.contains(&name.as_str())) {
        return Err(format!("--effects: expected `all` or names out of {}, found {unknown}", EFFECTS.join(", ")));
    }
    let motions = motions(&arguments.motions)?;
    let mut orders: Vec<Order> = Vec::new();
    let of = |case, wanted, turn| Order { case, wanted, turn, motion: Motion::Mixed, is_of_study: false };
    for round in 0..arguments.per_effect {
        // Neighbours differ, so that one recording of each effect already uses both engines.
        let single = |(i, name): (usize, &String)| of("single", FaultRequest::Effects(vec![name.clone()]), i + round);
        let motion = motions[round % motions.len()];
        let shown = effects.iter().enumerate().filter(|(_, name)| motion.shows(name));
        orders.extend(shown.map(|of_name| Order { motion, ..single(of_name) }));
    }
    let sound = |i: usize| Order { motion: motions[i % motions.len()], ..of("none", FaultRequest::Nothing, i) };
    orders.extend((0..arguments.none).map(sound));
    let withheld = |i: usize| FaultRequest::Withheld(WITHHELD[i % WITHHELD.len()].into());
    // After all of them once, each comes with the other engine.
    orders.extend((0..arguments.withheld).map(|i| of("withheld", withheld(i), i)));
    let pool = if effects.is_empty() { EFFECTS.map(String::from).to_vec() } else { effects };
    let mut draws = SplitMix64::new(sub_seed(arguments.seed, u64::MAX));
    for turn in 0..arguments.pairs {
        let names = pair(&pool, &mut draws).ok_or("--pairs: expected two effects of different confusable groups")?;
        orders.push(of("pair", FaultRequest::Effects(names), turn));
    }
    orders.extend((0..arguments.study).map(|turn| of_study(arguments.seed, turn)));
    if orders.is_empty() && arguments.mixed == 0 {
        let expected = "--effects, --none, --withheld, --pairs, --study or --mixed";
        return Err(format!("expected {expected}, found nothing to record"));
    }
    Ok(orders)
}

/// Motions by name, or `all`.
fn motions(names: &[String]) -> Result<Vec<Motion>, String> {
    let known = || Motion::ALL.map(Motion::name).join(", ");
    let of_name = |name: &String| {
        let found = Motion::ALL.into_iter().find(|motion| motion.name() == name);
        found.ok_or_else(|| format!("--motions: expected `all` or names out of {}, found {name}", known()))
    };
    match names.iter().any(|name| name == "all") {
        true => Ok(Motion::ALL.to_vec()),
        false => names.iter().map(of_name).collect(),
    }
}

/// A recording of a study: motion and effects are drawn from the seed and its turn.
fn of_study(seed: u64, turn: usize) -> Order {
    let mut draws = SplitMix64::new(sub_seed(sub_seed(seed, u64::MAX - 1), turn as u64));
    let motion = Motion::ALL[draws.index(Motion::ALL.len())];
    let shown = |names: &[&str]| -> Vec<String> {
        names.iter().filter(|name| motion.shows(name)).map(|name| (*name).to_owned()).collect()
    };
    let (effects, withheld) = (shown(&EFFECTS), shown(&WITHHELD));
    let kind = draws.uniform();
    let (case, wanted) = if kind < 0.35 {
        ("none", FaultRequest::Nothing)
    } else if kind < 0.75 {
        ("single", FaultRequest::Effects(vec![effects[draws.index(effects.len())].clone()]))
    } else if kind < 0.85 {
        ("pair", FaultRequest::Effects(pair(&effects, &mut draws).expect("effects of several groups")))
    } else {
        ("withheld", FaultRequest::Withheld(withheld[draws.index(withheld.len())].clone()))
    };
    Order { case, wanted, turn, motion, is_of_study: true }
}

/// Two effects that are not known to be confused with each other.
fn pair(pool: &[String], draws: &mut SplitMix64) -> Option<Vec<String>> {
    let pairs: Vec<(&String, &String)> = pool
        .iter()
        .flat_map(|a| pool.iter().map(move |b| (a, b)))
        .filter(|(a, b)| a < b && !confusable_group(a).contains(&b.as_str()))
        .collect();
    pairs.get(draws.index(pairs.len())).map(|(a, b)| vec![(*a).clone(), (*b).clone()])
}
