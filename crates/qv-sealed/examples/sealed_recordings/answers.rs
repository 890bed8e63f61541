//! The answer to one recording, as JSON.

use qv_go2::model::JOINT_NAMES;
use qv_sealed::{Cause, DrawnRecipe, Engine, MixedGround, Section, Withheld};
use serde_json::{Map, Value, json};

/// Everything about one recording.
pub fn of(case: &str, drawn: &DrawnRecipe, redraws: u64) -> Value {
    let recipe = &drawn.recipe;
    let mut effects: Vec<Value> = recipe.causes.iter().map(cause).collect();
    effects.extend(recipe.withheld.iter().map(withheld));
    let sections: Vec<Value> = recipe.plan.sections.iter().map(|(s, length)| section(s, *length)).collect();
    json!({
        "case": case,
        "effects": effects,
        "in_library": recipe.withheld.is_none(),
        "seed": recipe.seed,
        "engine": engine(&recipe.engine),
        "other_engine": drawn.other_engine,
        "gains": {"kp": recipe.kp, "kd": recipe.kd},
        "motion": sections,
        "duration": recipe.plan.duration(),
        // A robot that fell was drawn again.
        "fell": false,
        "redraws": redraws,
        "parameters": recipe.parameters().into_iter().map(|(name, value)| (name, json!(value))).collect::<Map<_, _>>(),
        "twin": null,
    })
}

/// Everything about one recording on mixed ground. Contact times are not known of one that was only redrawn.
pub fn of_mixed(mixed: &MixedGround, redraws: u64) -> Value {
    let recipe = &mixed.recipe;
    let materials = recipe.ground.iter().flat_map(|mesh| &mesh.materials);
    json!({
        "case": "mixed",
        "frictions": materials.map(|m| (m.name.clone(), json!(m.friction))).collect::<Map<_, _>>(),
        "slippery": mixed.slippery,
        "faults": recipe.causes.iter().map(cause).collect::<Vec<_>>(),
        "seed": recipe.seed,
        "engine": engine(&recipe.engine),
        "gains": {"kp": recipe.kp, "kd": recipe.kd},
        "motion": recipe.plan.sections.iter().map(|(s, length)| section(s, *length)).collect::<Vec<_>>(),
        "duration": recipe.plan.duration(),
        "redraws": redraws,
    })
}

fn cause(cause: &Cause) -> Value {
    let figures = cause.figures.iter().map(|f| {
        json!({"name": f.name, "value": f.value, "unit": f.unit, "range": [f.range.0, f.range.1], "asked": f.asked})
    });
    let of_joint = |joint: &&str| cause.settings.iter().any(|(name, _)| name.contains(*joint));
    json!({
        "effect": cause.effect,
        "joints": JOINT_NAMES.iter().copied().filter(|joint| of_joint(joint)).collect::<Vec<_>>(),
        "interface": qv_sealed::interface(cause.effect),
        "group": qv_sealed::confusable_group(cause.effect),
        "scope": cause.scope,
        "region": cause.region.map(|r| json!({"x": r.x, "y": r.y, "met": r.met})),
        "parameters": figures.collect::<Vec<_>>(),
    })
}

fn withheld(effect: &Withheld) -> Value {
    let joints = effect.joints.iter().map(|&j| JOINT_NAMES[j]).collect::<Vec<_>>();
    let sizes = effect.sizes.iter().map(|(name, value, unit)| json!({"name": name, "value": value, "unit": unit}));
    json!({
        "effect": effect.name,
        "relatives": effect.relatives(),
        "joints": joints,
        "scope": [],
        "parameters": sizes.collect::<Vec<_>>(),
    })
}

fn engine(engine: &Engine) -> Value {
    match engine {
        Engine::Ours { timestep, impratio, contact_dimension, time_constant } => json!({
            "name": engine.name(), "timestep": timestep, "impratio": impratio,
            "contact_dimension": contact_dimension, "time_constant": time_constant,
        }),
        Engine::Second { timestep, substeps } => {
            json!({"name": engine.name(), "timestep": timestep, "substeps": substeps})
        }
    }
}

fn section(section: &Section, length: f64) -> Value {
    let mut out = json!({"name": section.name(), "length": length});
    match section {
        Section::Trot { gait, turn } => {
            out["frequency"] = json!(gait.frequency);
            out["swing"] = json!(gait.swing);
            out["lift"] = json!(gait.lift);
            out["turn"] = json!(turn);
        }
        Section::Chirp(chirp) => out["end_frequency"] = json!(chirp.end),
        Section::Squat(squat) => out["frequency"] = json!(squat.frequency),
        Section::Sway { frequency, .. } | Section::Lean { frequency, .. } => out["frequency"] = json!(frequency),
        Section::Stand => {}
    }
    out
}
