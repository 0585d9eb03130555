//! Finding what a model lacks: where simulation and measurement disagree, which effect of the library does it, and how
//! much smaller the gap is with it.

mod fit;
mod hypothesis;
mod library;
mod linear;
mod noise;
mod response;
mod rows;
mod scan;
mod screen;
mod simulate;
mod trace;

#[cfg(test)]
mod scratch;
