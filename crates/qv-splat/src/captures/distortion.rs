//! OpenCV's lens distortion with three radial and two tangential coefficients, and its inverse.

use glam::DVec2;

/// Coefficients of Brown's model as OpenCV has them (camera calibration, `k_1, k_2, p_1, p_2, k_3`): with x, y on the plane z = 1
/// and r² = x² + y², the distorted x is x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and likewise y with p1 and p2
/// exchanged.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, of r².
    pub k1: f64,
    /// Radial, of r⁴.
    pub k2: f64,
    /// Radial, of r⁶.
    pub k3: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
}

/// Steps of Newton's method before a point counts as one that no ray reaches.
const MOST_STEPS: usize = 30;
/// Residual at which a step is the last, in units of the plane z = 1.
const RESIDUAL: f64 = 1e-12;

impl Distortion {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// # Errors
    /// The coefficient that is not finite, in words.
    pub(super) fn check(&self) -> Result<(), String> {
        let all = [("k1", self.k1), ("k2", self.k2), ("k3", self.k3), ("p1", self.p1), ("p2", self.p2)];
        match all.iter().find(|(_, value)| !value.is_finite()) {
            Some((name, value)) => Err(format!("{name} = {value}")),
            None => Ok(()),
        }
    }

    /// A point on the plane z = 1 to where the lens shows it.
    pub fn distort(&self, point: DVec2) -> DVec2 {
        let DVec2 { x, y } = point;
        let r2 = point.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        DVec2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// The point that the lens shows at `shown`, by Newton's method from the centre outwards; `None` where there is none, or
    /// none on this side of the fold of a strong lens.
    pub fn undistort(&self, shown: DVec2) -> Option<DVec2> {
        if self.is_none() {
            return Some(shown);
        }
        let mut point = shown;
        for _ in 0..MOST_STEPS {
            let error = self.distort(point) - shown;
            let [a, b, c, d] = self.derivative(point);
            let determinant = a * d - b * c;
            // Beyond the fold the derivative turns over; whatever is found there is not what the lens shows.
            if determinant.is_nan() || determinant <= 1e-6 || a + d <= 0.0 {
                return None;
            }
            if error.length() <= RESIDUAL * (1.0 + shown.length()) {
                return Some(point);
            }
            point -= DVec2::new(d * error.x - b * error.y, a * error.y - c * error.x) / determinant;
        }
        None
    }

    /// Whether the map turns over somewhere between the axis and a point: what is shown beyond is shown twice.
    pub(crate) fn folds_before(&self, point: DVec2) -> bool {
        const STEPS: u32 = 32;
        !self.is_none()
            && (1..=STEPS).any(|step| {
                let [a, b, c, d] = self.derivative(point * (f64::from(step) / f64::from(STEPS)));
                let determinant = a * d - b * c;
                determinant.is_nan() || determinant <= 1e-6 || a + d <= 0.0
            })
    }

    /// Derivatives of the shown point: x by x, x by y, y by x, y by y.
    fn derivative(&self, point: DVec2) -> [f64; 4] {
        let DVec2 { x, y } = point;
        let r2 = point.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let mixed = x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        [
            radial + x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            mixed,
            mixed,
            radial + y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Distortion = Distortion { k1: -0.2, k2: 0.05, k3: -0.01, p1: 0.002, p2: -0.003 };

    #[test]
    fn undistorting_undoes_distorting() {
        for i in 0..100 {
            let point = DVec2::new((i % 10) as f64 - 4.5, (i / 10) as f64 - 4.5) * 0.15;
            let back = LENS.undistort(LENS.distort(point)).unwrap();
            assert!((back - point).length() < 1e-10, "{point} {back}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_map() {
        let (point, h) = (DVec2::new(0.3, -0.4), 1e-6);
        let by = |step: DVec2| (LENS.distort(point + step) - LENS.distort(point - step)) / (2.0 * h);
        let (dx, dy) = (by(DVec2::new(h, 0.0)), by(DVec2::new(0.0, h)));
        for (found, expected) in LENS.derivative(point).iter().zip([dx.x, dy.x, dx.y, dy.y]) {
            assert!((found - expected).abs() < 1e-8);
        }
    }

    #[test]
    fn beyond_the_fold_nothing_is_shown() {
        let barrel = Distortion { k1: -0.3, ..Default::default() };
        assert!(barrel.undistort(DVec2::new(5.0, 0.0)).is_none());
        assert!(barrel.undistort(DVec2::new(f64::NAN, 0.0)).is_none());
        assert_eq!(Distortion::default().undistort(DVec2::new(5.0, 0.0)), Some(DVec2::new(5.0, 0.0)));
    }
}
