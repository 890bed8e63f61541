//! What robots without an effect leave: the features of their windows, from replicates ([`qv_rollout::replicate`]) or reference recordings.

pub mod reference;
pub mod whitening;
