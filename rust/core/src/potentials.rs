//! The scalar functions of section 3: the double well Psi, the indicator chi, and the pair F, H of
//! the connectedness functional, each with its derivative; Psi and chi with the second one too.

/// Double well Psi(u) = 9/16 (u^2 - 1)^2, section 3.
#[inline]
#[must_use]
pub fn psi(u: f64) -> f64 {
    let w = u * u - 1.0;
    0.5625 * w * w
}

/// Psi'(u) = 9/4 u (u^2 - 1).
#[inline]
#[must_use]
pub fn psi_prime(u: f64) -> f64 {
    2.25 * u * (u * u - 1.0)
}

/// Psi''(u) = 9/4 (3 u^2 - 1).
#[inline]
#[must_use]
pub fn psi_second(u: f64) -> f64 {
    2.25 * (3.0 * u * u - 1.0)
}

/// Diffuse indicator chi(u) of the positive phase, section 3: a cubic from 0 at -(1 - delta) to
/// 1 at 1 - delta, C1, with chi(-u) = 1 - chi(u).
#[inline]
#[must_use]
pub fn chi(u: f64, delta: f64) -> f64 {
    let r = 1.0 - delta;
    if u <= -r {
        0.0
    } else if u >= r {
        1.0
    } else {
        let s = u + r;
        s * s * (2.0 * r - u) / (4.0 * r * r * r)
    }
}

/// chi'(u) = 3 (r^2 - u^2) / (4 r^3) within |u| < r = 1 - delta, else 0.
#[inline]
#[must_use]
pub fn chi_prime(u: f64, delta: f64) -> f64 {
    let r = 1.0 - delta;
    if u.abs() >= r {
        0.0
    } else {
        0.75 * (r * r - u * u) / (r * r * r)
    }
}

/// chi''(u) = -3 u / (2 r^3) within |u| < r = 1 - delta, else 0: chi' has kinks at |u| = r, where
/// chi'' jumps by 3 / (2 r^2).
#[inline]
#[must_use]
pub fn chi_second(u: f64, delta: f64) -> f64 {
    let r = 1.0 - delta;
    if u.abs() >= r {
        0.0
    } else {
        -1.5 * u / (r * r * r)
    }
}

/// The potentials F and H of the connectedness functional (3).
///
/// Their supports are complementary: F > 0 exactly below the threshold a = 1 - sqrt(epsilon), H > 0 exactly above it (Dondl, Novaga,
/// Wojtowytsch, Wolff-Vorbeck 2021). Both are C1, so C does not jump when a face joins a
/// component.
#[derive(Debug, Clone, Copy)]
pub struct ConnectednessPotentials {
    threshold: f64,
    width: f64,
}

impl ConnectednessPotentials {
    /// The potentials with the threshold `a`, 1 - sqrt(epsilon) in the paper, and H = 1 from `plateau` on,
    /// 1 in the paper.
    #[must_use]
    pub fn new(threshold: f64, plateau: f64) -> Self {
        Self {
            threshold,
            width: plateau - threshold,
        }
    }

    /// a: a face belongs to a component where its value is at least this.
    #[inline]
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// F(u) = (u - a)^2 below a, else 0: the price of a path.
    #[inline]
    #[must_use]
    pub fn f(&self, u: f64) -> f64 {
        let t = (u - self.threshold).min(0.0);
        t * t
    }

    /// F'(u) = 2 (u - a) below a, else 0.
    #[inline]
    #[must_use]
    pub fn f_prime(&self, u: f64) -> f64 {
        2.0 * (u - self.threshold).min(0.0)
    }

    /// H(u): the cubic 3 t^2 - 2 t^3 with t from 0 at a to 1 on the plateau: the mass of a component.
    #[inline]
    #[must_use]
    pub fn h(&self, u: f64) -> f64 {
        let t = ((u - self.threshold) / self.width).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// H'(u).
    #[inline]
    #[must_use]
    pub fn h_prime(&self, u: f64) -> f64 {
        let t = ((u - self.threshold) / self.width).clamp(0.0, 1.0);
        6.0 * t * (1.0 - t) / self.width
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_derivative(function: impl Fn(f64) -> f64, prime: impl Fn(f64) -> f64) {
        let step = 1e-6;
        for k in -150..=150 {
            let u = f64::from(k) / 100.0 + 0.003;
            let difference = (function(u + step) - function(u - step)) / (2.0 * step);
            assert!((difference - prime(u)).abs() < 1e-8, "at {u}");
        }
    }

    #[test]
    fn derivatives_match_differences() {
        check_derivative(psi, psi_prime);
        check_derivative(psi_prime, psi_second);
        for delta in [0.0, 0.02] {
            check_derivative(|u| chi(u, delta), |u| chi_prime(u, delta));
            check_derivative(|u| chi_prime(u, delta), |u| chi_second(u, delta));
        }
        let potentials = ConnectednessPotentials::new(0.8, 1.0);
        check_derivative(|u| potentials.f(u), |u| potentials.f_prime(u));
        let h = |u| potentials.h(u);
        for k in -150..=150 {
            let u = f64::from(k) / 100.0 + 0.003;
            let difference = (h(u + 1e-6) - h(u - 1e-6)) / 2e-6;
            assert!((difference - potentials.h_prime(u)).abs() < 1e-4);
        }
    }

    #[test]
    fn indicator_is_a_partition() {
        for k in -20..=20 {
            let u = f64::from(k) / 10.0;
            assert!((chi(u, 0.01) + chi(-u, 0.01) - 1.0).abs() < 1e-15);
        }
        assert_eq!(chi(0.0, 0.0), 0.5);
    }

    #[test]
    fn supports_are_complementary() {
        let potentials = ConnectednessPotentials::new(0.7, 1.0);
        assert!((potentials.threshold() - 0.7).abs() < 1e-15);
        assert!(potentials.f(0.69) > 0.0 && potentials.h(0.69) == 0.0);
        assert!(potentials.f(0.71) == 0.0 && potentials.h(0.71) > 0.0);
        assert_eq!(potentials.h(1.0), 1.0);
        assert_eq!(potentials.h(1.3), 1.0);
        assert_eq!(ConnectednessPotentials::new(0.1, 0.4).h(0.4), 1.0);
    }
}
