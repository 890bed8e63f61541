//! Which recordings are asked for, in their fixed order.

use crate::Arguments;
use qv_core::random::{SplitMix64, sub_seed};
use qv_sealed::{EFFECTS, FaultRequest, WITHHELD, confusable_group};

/// One recording to make.
pub struct Order {
    /// `none`, `single`, `pair` or `withheld`.
    pub case: &'static str,
    pub wanted: FaultRequest,
    /// Which one of its kind, for taking turns.
    pub turn: usize,
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
    let mut orders: Vec<Order> = Vec::new();
    let of = |case, wanted, turn| Order { case, wanted, turn };
    for round in 0..arguments.per_effect {
        // Neighbours differ, so that one recording of each effect already uses both engines.
        let single = |(i, name): (usize, &String)| of("single", FaultRequest::Effects(vec![name.clone()]), i + round);
        orders.extend(effects.iter().enumerate().map(single));
    }
    orders.extend((0..arguments.none).map(|i| of("none", FaultRequest::Nothing, i)));
    let withheld = |i: usize| FaultRequest::Withheld(WITHHELD[i % WITHHELD.len()].into());
    // After all of them once, each comes with the other engine.
    orders.extend((0..arguments.withheld).map(|i| of("withheld", withheld(i), i)));
    let pool = if effects.is_empty() { EFFECTS.map(String::from).to_vec() } else { effects };
    let mut draws = SplitMix64::new(sub_seed(arguments.seed, u64::MAX));
    for turn in 0..arguments.pairs {
        let names = pair(&pool, &mut draws).ok_or("--pairs: expected two effects of different confusable groups")?;
        orders.push(of("pair", FaultRequest::Effects(names), turn));
    }
    if orders.is_empty() && arguments.mixed == 0 {
        return Err("expected --effects, --none, --withheld, --pairs or --mixed, found nothing to record".into());
    }
    Ok(orders)
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
