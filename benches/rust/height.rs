//! Height from normals: the cosine transforms and the passes around them.

use divan::{Bencher, counter::ItemsCount};
use impasto::height::integrate;
use impasto::pixels::serially;

use crate::painting::{SIDE, normal};

#[divan::bench]
fn integrate_normals(bencher: Bencher<'_, '_>) {
    let normal = normal();
    bencher
        .counter(ItemsCount::new(SIDE * SIDE))
        .bench_local(|| serially(|run| integrate(&normal, SIDE, SIDE, 0.1, run).expect("it fits")));
}
