//! The genetic algorithm: every operator has the statistics its definition demands, and the whole converges.
//!
//! Statistical tests run on fixed seeds, so they never flicker. Their bounds are 5 standard deviations of a binomial
//! count, or the 1 - 1e-6 quantile of chi-square: at another seed, code that is right would exceed one with a
//! probability below 1e-6 (times the number of counts looked at).

mod common;
mod search;
mod selection;
mod variation;
