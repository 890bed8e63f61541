//! Sums over rows: all that fits, losses and standard errors need.

use crate::balance::{Balance, Column, Equation, Robot, TERMS, Term};
use crate::regressor::INERTIAL;
use qv_fit::linear::{Matrix, add_scaled_matrix, from_columns, gram};
use std::ops::Range;

/// Sums of products of an equation's columns and `y`, shape `[columns + 1, columns + 1]`.
#[derive(Clone)]
pub(crate) struct Gram {
    pub rows: f64,
    pub sums: Matrix,
}

impl Gram {
    /// Of some rows of columns, shape `[columns][rows]`.
    pub fn of(columns: &[Vec<f64>], rows: Range<usize>) -> Self {
        let picked: Vec<Vec<f64>> = columns.iter().map(|c| c[rows.clone()].to_vec()).collect();
        Self { rows: rows.len() as f64, sums: gram(&from_columns(rows.len(), &picked)) }
    }

    pub fn add(&mut self, other: &Self) {
        self.rows += other.rows;
        add_scaled_matrix(&mut self.sums, 1.0, &other.sums);
    }
}

/// Places of all columns of a robot in one vector; `y` is the last.
#[derive(Clone, Copy)]
pub(crate) struct Layout {
    pub joints: usize,
    pub links: usize,
}

impl Layout {
    pub fn of(robot: &Robot) -> Self {
        Self { joints: robot.joints(), links: robot.model.links.len() }
    }

    /// Number of columns, which is the place of `y`.
    pub fn width(self) -> usize {
        TERMS.len() * self.joints + INERTIAL * self.links
    }

    pub fn place(self, column: Column) -> usize {
        match column {
            Column::Joint(joint, term) => TERMS.len() * joint + term as usize,
            Column::Link(link, k) => TERMS.len() * self.joints + INERTIAL * link + k,
        }
    }

    /// Place of the first parameter of the first link.
    pub fn place_of_links(self) -> usize {
        TERMS.len() * self.joints
    }

    /// Joint and term of a place; none for links.
    pub fn term(self, place: usize) -> Option<(usize, Term)> {
        let joint = place / TERMS.len();
        (joint < self.joints).then(|| (joint, TERMS[place % TERMS.len()]))
    }
}

/// Weighted sums of all equations, shape `[width + 1, width + 1]`.
pub(crate) fn assemble(layout: Layout, equations: &[Equation], weights: &[f64], grams: &[Gram]) -> Matrix {
    let width = layout.width();
    let mut all = Matrix::zeros(width + 1, width + 1);
    for ((equation, weight), own) in equations.iter().zip(weights).zip(grams) {
        let places: Vec<usize> = equation.columns.iter().map(|&c| layout.place(c)).chain([width]).collect();
        for (k, &to) in places.iter().enumerate() {
            for (i, &from) in places.iter().enumerate() {
                all[(from, to)] += weight * own.sums[(i, k)];
            }
        }
    }
    all
}

/// Rows of each block, in order: pieces of a length \[s\] of each run, of rows at `time` of `run`.
pub(crate) fn blocks(time: &[f64], run: &[usize], length: f64) -> Vec<Range<usize>> {
    let mut all: Vec<Range<usize>> = Vec::new();
    let mut start = 0;
    for k in 1..time.len() {
        // Whole pieces by the clock, so that rows of both bands are parted at the same instants.
        if run[k] != run[start] || (time[k] / length).floor() != (time[start] / length).floor() {
            all.push(start..k);
            start = k;
        }
    }
    all.push(start..time.len());
    all
}

/// Sums of each equation over all rows of the narrow band, and of the wide one.
pub(crate) fn totals(balance: &Balance) -> [Vec<Gram>; 2] {
    let of = |values: &[Vec<f64>], rows: usize| Gram::of(values, 0..rows);
    let narrow = balance.equations.iter().map(|e| of(&e.values, balance.time.len())).collect();
    let wide = balance.equations.iter().map(|e| of(&e.wide, balance.wide_time.len())).collect();
    [narrow, wide]
}
