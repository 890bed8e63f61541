//! What a gap that no single effect explains looks like when several are fitted at once: no accusation. On real machines several things are
//! off together, and the effect that fits best alone takes over what belongs to the others.

use crate::GapError;
use crate::checks::held_out::closure;
use crate::findings::{Together, TogetherEffect};
use crate::inference::intervals::estimates_of;
use crate::inference::level::level;
use crate::inference::linearised::LinearisedProblem;
use crate::inference::search::{Fit, Search};
use crate::problem::columns::Suspect;

/// The best fits of a round taken together; `None` where fewer than two of them are needed.
///
/// # Errors
/// When a value means nothing.
pub fn together(study: &mut LinearisedProblem, fits: &[Fit], seed: u64) -> Result<Option<Together>, GapError> {
    let level = level(study)?;
    let null = level.null * level.count;
    let mut search = Search::new(study, 1.0)?;
    let Some(found) = search.together(fits, null)? else { return Ok(None) };
    let suspects: Vec<Suspect> = found.fits.iter().map(|f| f.suspect.clone()).collect();
    let setting = study.columns.setting_of(&study.rollout, &suspects);
    let gap = closure(study, &setting)?.gap(study, seed);
    let name = |group: usize| study.columns.effects[study.columns.groups[group].effect].name.clone();
    let mut effects: Vec<TogetherEffect> = Vec::new();
    for fit in &found.fits {
        let group = fit.suspect.group;
        effects.push(TogetherEffect {
            effect: name(group),
            scope: study.columns.groups[group].names.clone(),
            parameters: estimates_of(study, fit),
            log_likelihood_ratio: fit.evidence,
            alike: found.alike.iter().filter(|a| a[0] == group).map(|a| name(a[1])).collect(),
        });
    }
    effects.sort_by(|a, b| b.log_likelihood_ratio.total_cmp(&a.log_likelihood_ratio));
    let remarks = Together {
        effects,
        closed: gap.closed,
        closed_ci95: gap.closed_ci95,
        joint_rms: gap.joint_rms,
        level: found.loss / null,
    };
    Ok((remarks.effects.len() > 1).then_some(remarks))
}
