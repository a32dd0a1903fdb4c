//! A queue for searches by distance.

/// Bits of a distance that do not count: what is left orders distances to 2^-10 of themselves.
const DROPPED: u32 = 42;

/// A radix heap (Ahuja, Mehlhorn, Orlin, Tarjan 1990) on the leading bits of the distances: no
/// distance that is pushed may be smaller than the last one popped.
///
/// Distances that agree in these bits come in any order. A search therefore has to take up a node
/// again whenever it finds a shorter way there, even after the node was popped. That is rare, while
/// a queue in strict order takes twice as long.
#[derive(Debug)]
pub(super) struct RadixHeap {
    /// Entry 0 has the key `last`; the keys of entry i differ from it in bit i - 1 and in none
    /// higher.
    buckets: [Vec<(f64, u32)>; 33],
    occupied: u64,
    last: u32,
}

impl Default for RadixHeap {
    fn default() -> Self {
        Self {
            buckets: [const { Vec::new() }; 33],
            occupied: 0,
            last: 0,
        }
    }
}

fn key(distance: f64) -> u32 {
    (distance.to_bits() >> DROPPED) as u32
}

impl RadixHeap {
    pub(super) fn clear(&mut self) {
        self.buckets.iter_mut().for_each(Vec::clear);
        self.occupied = 0;
        self.last = 0;
    }

    /// Adds a node at a `distance` that is not negative.
    #[inline]
    pub(super) fn push(&mut self, distance: f64, node: u32) {
        let bucket = 32 - (key(distance) ^ self.last).leading_zeros();
        self.buckets[bucket as usize].push((distance, node));
        self.occupied |= 1 << bucket;
    }

    #[inline]
    pub(super) fn pop(&mut self) -> Option<(f64, u32)> {
        if self.buckets[0].is_empty() {
            self.refill()?;
        }
        self.buckets[0].pop()
    }

    /// Spreads the first bucket that holds anything over those before it.
    fn refill(&mut self) -> Option<()> {
        self.occupied &= !1;
        if self.occupied == 0 {
            return None;
        }
        let first = self.occupied.trailing_zeros() as usize;
        self.occupied &= self.occupied - 1;
        let mut entries = std::mem::take(&mut self.buckets[first]);
        self.last = entries.iter().map(|entry| key(entry.0)).min()?;
        for (distance, node) in entries.drain(..) {
            self.push(distance, node);
        }
        self.buckets[first] = entries;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pops_in_order_of_the_leading_bits() {
        let mut heap = RadixHeap::default();
        let mut popped = Vec::new();
        for round in 0..2 {
            for i in 0..500_u32 {
                heap.push(
                    (f64::from(i) * 0.7).sin().abs() * 10_f64.powi(i as i32 % 9),
                    i,
                );
            }
            popped.clear();
            while let Some((distance, node)) = heap.pop() {
                if node < 500 {
                    heap.push(distance * 1.5, node + 500);
                    heap.push(distance, node + 1000);
                }
                popped.push((distance, node));
            }
            assert_eq!(popped.len(), 1500);
            assert!(popped.is_sorted_by_key(|&(distance, _)| key(distance)));
            let mut nodes: Vec<u32> = popped.iter().map(|entry| entry.1).collect();
            nodes.sort_unstable();
            assert!(nodes.into_iter().eq(0..1500));
            heap.clear();
            assert_eq!(heap.pop(), None, "round {round}");
        }
    }
}
