//! Every effect of the library: its signature against a calculation by hand, nothing of it when off, and derivatives.

#[path = "../robot/mod.rs"]
mod robot;

mod axis;
mod catalogue;
mod derivatives;
mod drive;
mod friction;
mod links;
mod off;
mod shaft;
mod strangers;
