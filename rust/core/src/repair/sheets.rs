//! Faces joined along edges to oriented manifold sheets.
//!
//! Half-edge `3 f + k` runs from corner `k` of face `f` to corner `(k + 1) % 3`, and has the number
//! of the corner that it starts from. Faces are joined by `partner`, not by what their vertices are
//! called: opening an edge or a vertex is leaving out a partner.

use petgraph::unionfind::UnionFind;
use rayon::prelude::*;

use super::Defects;
use crate::mesh::{NONE, cross, dot, subtract};

/// Turns between faces that differ by less than this are equal: rounding does not pair them.
const TURN: f64 = 1e-9;

/// Faces around one edge that are compared each with each; of more, each is compared with those
/// that continue it best.
const FEW: usize = 8;

/// Rounds that open edges along which a sheet touches itself. Each does one at a vertex, and
/// voxels, which touch most, need two or three.
const ROUNDS: usize = 16;

/// Faces over welded vertices, and what is joined.
pub(super) struct Sheets<'a> {
    positions: &'a [[f64; 3]],
    /// Welded vertices of the faces.
    pub(super) faces: Vec<[u32; 3]>,
    /// Vertices that the file names at the corners of the faces.
    named: Vec<[u32; 3]>,
    /// Polygons of the faces. Those of one polygon stay together across its diagonals.
    polygon: Vec<u32>,
    /// Whether a face is to be turned over against the input.
    pub(super) flipped: Vec<bool>,
    /// Whether it is turned over in `faces`; its second and third corner are then exchanged.
    pub(super) turned: Vec<bool>,
    /// The half-edge across, [`NONE`] at the boundary.
    pub(super) partner: Vec<u32>,
    /// Half-edges of the edges that are not joined as they are: of several faces, of two faces on
    /// the same vertices, cut or opened.
    pub(super) edges: Vec<Vec<u32>>,
    pub(super) defects: Defects,
}

/// The next corner of the same face.
pub(super) fn next(corner: u32) -> u32 {
    if corner % 3 == 2 {
        corner - 2
    } else {
        corner + 1
    }
}

fn previous(corner: u32) -> u32 {
    if corner.is_multiple_of(3) {
        corner + 2
    } else {
        corner - 1
    }
}

/// A pair of half-edges of one non-manifold edge; the order is that in which they are joined.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    /// 0 where the faces run along the edge in opposite directions.
    against: u8,
    /// 0 where the file has the edge between the same vertices.
    apart: u8,
    /// From flat to folded.
    turn: i64,
    /// 0 where the edge is convex.
    concave: u8,
    sides: [u32; 2],
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt();
    v.map(|x| x / length)
}

impl<'a> Sheets<'a> {
    /// Joins and orients faces with three different vertices each, none of them twice in the same
    /// winding.
    pub(super) fn new(
        positions: &'a [[f64; 3]],
        faces: Vec<[u32; 3]>,
        named: Vec<[u32; 3]>,
        polygon: Vec<u32>,
        areas: &[f64],
    ) -> Self {
        let mut sides: Vec<(u64, u32)> = faces
            .par_iter()
            .enumerate()
            .flat_map_iter(|(f, face)| {
                (0..3).map(move |k| {
                    let (a, b) = (face[k], face[(k + 1) % 3]);
                    let edge = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
                    (edge, 3 * f as u32 + k as u32)
                })
            })
            .collect();
        sides.par_sort_unstable();
        let mut sheets = Self {
            positions,
            flipped: vec![false; faces.len()],
            turned: Vec::new(),
            partner: vec![NONE; sides.len()],
            edges: Vec::new(),
            defects: Defects::default(),
            faces,
            named,
            polygon,
        };
        for edge in sides.chunk_by(|a, b| a.0 == b.0) {
            match edge {
                [_] => {}
                [(_, one), (_, other)] if !sheets.same_vertices(*one, *other) => {
                    sheets.join([*one, *other]);
                }
                _ => {
                    sheets.defects.non_manifold_edges += usize::from(edge.len() > 2);
                    let edge: Vec<u32> = edge.iter().map(|side| side.1).collect();
                    sheets.join_diagonals(&edge);
                    sheets.edges.push(edge);
                }
            }
        }
        let patch = sheets.orient_patches(areas);
        sheets.join_patches(&patch);
        sheets.turn_over();
        sheets.separate();
        sheets
    }

    fn same_vertices(&self, one: u32, other: u32) -> bool {
        self.apex(one) == self.apex(other)
    }

    /// The vertex of the face that is not on the edge.
    fn apex(&self, side: u32) -> u32 {
        self.at(previous(side))
    }

    fn at(&self, corner: u32) -> u32 {
        self.faces[(corner / 3) as usize][(corner % 3) as usize]
    }

    fn join(&mut self, [one, other]: [u32; 2]) {
        self.partner[one as usize] = other;
        self.partner[other as usize] = one;
    }

    /// Joins sides of one polygon, whatever else lies at the edge: they are its diagonal.
    fn join_diagonals(&mut self, edge: &[u32]) {
        for (i, &one) in edge.iter().enumerate() {
            if self.partner[one as usize] != NONE {
                continue;
            }
            let other = edge[i + 1..].iter().copied().find(|&other| {
                self.of_one_polygon(one, other)
                    && self.partner[other as usize] == NONE
                    && self.at(one) != self.at(other)
                    && !self.same_vertices(one, other)
            });
            if let Some(other) = other {
                self.join([one, other]);
            }
        }
    }

    fn of_one_polygon(&self, one: u32, other: u32) -> bool {
        self.polygon[(one / 3) as usize] == self.polygon[(other / 3) as usize]
    }

    /// Whether a side is joined to one of its own polygon.
    fn is_diagonal(&self, side: u32) -> bool {
        let other = self.partner[side as usize];
        other != NONE && self.of_one_polygon(side, other)
    }

    fn open(&mut self, side: u32) {
        let other = std::mem::replace(&mut self.partner[side as usize], NONE);
        if other != NONE {
            self.partner[other as usize] = NONE;
        }
    }

    /// Whether two sides of an edge run along it in opposite directions, as the faces now stand.
    fn agree(&self, one: u32, other: u32) -> bool {
        let turned = self.flipped[(one / 3) as usize] != self.flipped[(other / 3) as usize];
        (self.at(one) != self.at(other)) != turned
    }

    /// Orients what hangs together across manifold edges, breadth first; returns the patch of each
    /// face. Where an edge would join a patch to its own back, it is cut.
    fn orient_patches(&mut self, areas: &[f64]) -> Vec<u32> {
        let mut patch = vec![NONE; self.faces.len()];
        let mut queue: Vec<u32> = Vec::new();
        let mut count = 0;
        for seed in 0..self.faces.len() {
            if patch[seed] != NONE {
                continue;
            }
            queue.clear();
            queue.push(seed as u32);
            patch[seed] = count;
            self.orient_polygon(seed as u32, &mut patch, &mut queue);
            let mut head = 0;
            while let Some(&f) = queue.get(head) {
                head += 1;
                for side in 3 * f..3 * f + 3 {
                    let other = self.partner[side as usize];
                    if other == NONE {
                        continue;
                    }
                    let g = (other / 3) as usize;
                    if patch[g] == NONE {
                        patch[g] = count;
                        self.flipped[g] = !self.agree(side, other);
                        queue.push(g as u32);
                        self.orient_polygon(g as u32, &mut patch, &mut queue);
                    } else if !self.agree(side, other) {
                        self.open(side);
                        self.edges.push(vec![side, other]);
                        self.defects.cut_edges += 1;
                    }
                }
            }
            self.keep_majority(&queue, areas);
            count += 1;
        }
        patch
    }

    /// Orients the rest of a face's polygon as the face, so that no cut runs along a diagonal.
    fn orient_polygon(&mut self, face: u32, patch: &mut [u32], queue: &mut Vec<u32>) {
        let mut head = queue.len() - 1;
        let mut at = face;
        loop {
            for side in 3 * at..3 * at + 3 {
                if !self.is_diagonal(side) {
                    continue;
                }
                let other = self.partner[side as usize];
                let g = (other / 3) as usize;
                if patch[g] == NONE {
                    patch[g] = patch[face as usize];
                    self.flipped[g] = !self.agree(side, other);
                    queue.push(g as u32);
                }
            }
            head += 1;
            let Some(&next) = queue.get(head) else {
                return;
            };
            at = next;
        }
    }

    /// Turns connected faces over where that flips less area of the input.
    fn keep_majority(&mut self, faces: &[u32], areas: &[f64]) {
        let mut sums = [0.0; 2];
        for &f in faces {
            sums[usize::from(self.flipped[f as usize])] += areas[f as usize];
        }
        let first = faces
            .iter()
            .min()
            .is_some_and(|&f| self.flipped[f as usize]);
        if sums[1] > sums[0] || (sums[1] == sums[0] && first) {
            for &f in faces {
                self.flipped[f as usize] ^= true;
            }
        }
    }

    /// Joins faces around non-manifold edges in pairs: first those of consistent orientation, of
    /// them those that the file joins, of them the flattest. Then patches are turned over for more.
    fn join_patches(&mut self, patch: &[u32]) {
        let count = patch.iter().max().map_or(0, |&last| last as usize + 1);
        let mut parity = Parity::new(count);
        let mut later = Vec::new();
        for edge in 0..self.edges.len() {
            if self.edges[edge].len() < 3 {
                continue;
            }
            let mut candidates = self.candidates(&self.edges[edge]);
            candidates.sort_unstable();
            for candidate in candidates {
                let [one, other] = candidate.sides;
                if candidate.against == 1 {
                    later.push(candidate);
                } else if self.partner[one as usize] == NONE && self.partner[other as usize] == NONE
                {
                    self.join([one, other]);
                    parity.join([one, other].map(|side| patch[(side / 3) as usize]), false);
                }
            }
        }
        later.retain(|candidate| {
            candidate
                .sides
                .iter()
                .all(|&s| self.partner[s as usize] == NONE)
        });
        later.sort_unstable();
        for Candidate { sides, .. } in later {
            let free = sides
                .iter()
                .all(|&side| self.partner[side as usize] == NONE);
            if free && parity.join(sides.map(|side| patch[(side / 3) as usize]), true) {
                self.join(sides);
            }
        }
        for (flipped, &patch) in self.flipped.iter_mut().zip(patch) {
            *flipped ^= parity.find(patch).1;
        }
    }

    /// The unit vector along a side.
    fn along(&self, side: u32) -> [f64; 3] {
        let [a, b] = [side, next(side)].map(|corner| self.positions[self.at(corner) as usize]);
        unit(subtract(b, a))
    }

    /// The unit vector from a side into its face, at right angles to the side.
    fn inward(&self, side: u32) -> [f64; 3] {
        let [a, apex] = [self.at(side), self.apex(side)].map(|v| self.positions[v as usize]);
        let (along, arm) = (self.along(side), subtract(apex, a));
        let along = along.map(|x| x * dot(arm, along));
        unit(subtract(arm, along))
    }

    /// How sharply two faces meet: -1 where one continues the other, 1 where they are folded.
    fn turn(&self, one: u32, other: u32) -> f64 {
        dot(self.inward(one), self.inward(other))
    }

    fn candidates(&self, edge: &[u32]) -> Vec<Candidate> {
        let a = self.at(edge[0]);
        let along = self.along(edge[0]);
        let into: Vec<[f64; 3]> = edge.iter().map(|&side| self.inward(side)).collect();
        let forward: Vec<bool> = edge
            .iter()
            .map(|&side| (self.at(side) == a) != self.flipped[(side / 3) as usize])
            .collect();
        let candidate = |i: usize, j: usize| {
            let (one, other) = (edge[i.min(j)], edge[i.max(j)]);
            let normal = cross(if forward[i] { along } else { along.map(|x| -x) }, into[i]);
            Candidate {
                against: u8::from(forward[i] == forward[j]),
                apart: u8::from(self.named_ends(one) != self.named_ends(other)),
                turn: (dot(into[i], into[j]) / TURN).round() as i64,
                concave: u8::from(dot(normal, into[j]) > 0.0),
                sides: [one, other],
            }
        };
        let mut candidates: Vec<Candidate> = if edge.len() <= FEW {
            (0..edge.len())
                .flat_map(|i| (i + 1..edge.len()).map(move |j| (i, j)))
                .map(|(i, j)| candidate(i, j))
                .collect()
        } else {
            // By angle around the edge; the flattest are half a turn on.
            let up = cross(along, into[0]);
            let angle = |i: usize| dot(into[i], up).atan2(dot(into[i], into[0]));
            let mut order: Vec<(f64, usize)> = (0..edge.len()).map(|i| (angle(i), i)).collect();
            order.sort_unstable_by(|p, q| p.0.total_cmp(&q.0).then(p.1.cmp(&q.1)));
            let n = order.len();
            order
                .iter()
                .flat_map(|&(angle, i)| {
                    let half = angle - std::f64::consts::PI.copysign(angle);
                    let at = order.partition_point(|p| p.0 < half);
                    let order = &order;
                    (0..FEW).map(move |k| (i, order[(at + n + k - FEW / 2) % n].1))
                })
                .filter(|&(i, j)| i != j)
                .map(|(i, j)| candidate(i.min(j), i.max(j)))
                .collect()
        };
        candidates.retain(|c| !self.same_vertices(c.sides[0], c.sides[1]));
        candidates
    }

    /// The vertices that the file names at the ends of a side, smaller welded vertex first.
    fn named_ends(&self, side: u32) -> [u32; 2] {
        let ends = [side, next(side)];
        let named = ends.map(|c| self.named[(c / 3) as usize][(c % 3) as usize]);
        if self.at(ends[0]) < self.at(ends[1]) {
            named
        } else {
            [named[1], named[0]]
        }
    }

    /// Turns the flipped faces over. Then half-edges of partners are opposite.
    fn turn_over(&mut self) {
        let flipped = &self.flipped;
        let moved = |side: u32| {
            if side != NONE && flipped[(side / 3) as usize] {
                // The sides (a, b), (b, c), (c, a) are the last, second and first of (a, c, b).
                side / 3 * 3 + 2 - side % 3
            } else {
                side
            }
        };
        let mut partner = vec![NONE; self.partner.len()];
        for (side, &other) in self.partner.iter().enumerate() {
            partner[moved(side as u32) as usize] = moved(other);
        }
        self.partner = partner;
        for edge in &mut self.edges {
            for side in edge {
                *side = moved(*side);
            }
        }
        for (face, &flipped) in self.faces.iter_mut().zip(flipped) {
            if flipped {
                face.swap(1, 2);
            }
        }
        self.turned.clone_from(&self.flipped);
    }

    /// The fan of each corner: corners of one vertex that hang together across edges.
    pub(super) fn fans(&self) -> Vec<u32> {
        let mut fans = UnionFind::<u32>::new(self.partner.len());
        for (side, &other) in self.partner.iter().enumerate() {
            // Each pair twice, each time one of its ends.
            if other != NONE {
                fans.union(side as u32, next(other));
            }
        }
        fans.into_labeling()
    }

    /// Joins and opens edges otherwise until no two edges lie between the same two fans: a sheet
    /// that touches itself along an edge would have a non-manifold edge there.
    fn separate(&mut self) {
        if self.edges.is_empty() {
            return;
        }
        for round in 0.. {
            let fans = self.fans();
            let conflicts = self.conflicts(&fans);
            if conflicts.is_empty() {
                return;
            }
            if round >= ROUNDS {
                // A polygon that touches itself comes apart in the end.
                let whole = round < 2 * ROUNDS;
                for side in conflicts.into_iter().flatten() {
                    self.detach(side / 3, whole);
                }
                continue;
            }
            let mut touched = vec![false; self.partner.len()];
            for sides in conflicts {
                let ends = [sides[0], next(sides[0])];
                let [one, other] = ends.map(|corner| fans[corner as usize]);
                if touched[one as usize] || touched[other as usize] {
                    continue;
                }
                touched[one as usize] = true;
                touched[other as usize] = true;
                // Other pairs may lead into each other again.
                if round < ROUNDS / 2 && self.exchange(&sides) {
                    continue;
                }
                let [one, other] = ends.map(|corner| self.fan(corner));
                // A closed fan needs a cut more.
                if one.closed && !other.closed {
                    self.split(&other, &fans, fans[ends[0] as usize]);
                } else {
                    self.split(&one, &fans, fans[ends[1] as usize]);
                }
            }
        }
    }

    /// Exchanges the partners of two pairs of sides, which parts their fans at both ends; not where
    /// the faces would meet more sharply than before and than at a right angle.
    fn exchange(&mut self, sides: &[u32]) -> bool {
        let forward: Vec<[u32; 2]> = sides
            .iter()
            .filter(|&&side| self.at(side) == self.at(sides[0]))
            .map(|&side| [side, self.partner[side as usize]])
            .collect();
        let &[[a, b], [c, d]] = &forward[..] else {
            return false;
        };
        if sides.len() != 4 || b == NONE || d == NONE {
            return false;
        }
        if self.is_diagonal(a) || self.is_diagonal(c) {
            return false;
        }
        let bound = self.turn(a, b).max(self.turn(c, d)).max(0.0) + TURN;
        let legal = |one, other| !self.same_vertices(one, other) && self.turn(one, other) <= bound;
        if !(legal(a, d) && legal(c, b)) {
            return false;
        }
        self.join([a, d]);
        self.join([c, b]);
        true
    }

    /// Sides that lie between the same two fans and are not the two sides of one edge.
    fn conflicts(&self, fans: &[u32]) -> Vec<Vec<u32>> {
        let mut conflicts = Vec::new();
        for edge in &self.edges {
            let mut keyed: Vec<([u32; 2], u32)> = edge
                .iter()
                .map(|&side| {
                    let (a, b) = (fans[side as usize], fans[next(side) as usize]);
                    ([a.min(b), a.max(b)], side)
                })
                .collect();
            keyed.sort_unstable();
            for sides in keyed.chunk_by(|p, q| p.0 == q.0) {
                let joined = sides.len() == 2 && self.partner[sides[0].1 as usize] == sides[1].1;
                if sides.len() > 1 && !joined {
                    conflicts.push(sides.iter().map(|side| side.1).collect());
                }
            }
        }
        conflicts
    }

    /// Opens all sides of a face, or of the whole polygon that it belongs to.
    fn detach(&mut self, face: u32, whole: bool) {
        let mut faces = vec![face];
        let mut head = 0;
        while let Some(&face) = faces.get(head) {
            head += 1;
            for side in 3 * face..3 * face + 3 {
                let other = self.partner[side as usize];
                if whole && self.is_diagonal(side) {
                    if !faces.contains(&(other / 3)) {
                        faces.push(other / 3);
                    }
                } else if other != NONE {
                    self.open(side);
                    self.defects.opened_edges += 1;
                }
            }
        }
    }

    /// The corners around a vertex from one of them, or from the boundary.
    fn fan(&self, corner: u32) -> Fan {
        let mut first = corner;
        let mut closed = false;
        while self.partner[first as usize] != NONE {
            first = next(self.partner[first as usize]);
            if first == corner {
                closed = true;
                break;
            }
        }
        let mut corners = vec![first];
        let mut corner = first;
        loop {
            corner = self.partner[previous(corner) as usize];
            if corner == NONE || corner == first {
                return Fan { corners, closed };
            }
            corners.push(corner);
        }
    }

    /// Opens an edge of the fan between each two that lead to the fan `end`.
    fn split(&mut self, fan: &Fan, fans: &[u32], end: u32) {
        // The edge before corner k of the fan is its side; after the last comes one more.
        let n = fan.corners.len();
        let mut leads: Vec<usize> = (0..n)
            .filter(|&k| fans[next(fan.corners[k]) as usize] == end)
            .collect();
        if fan.closed && leads.len() > 1 {
            leads.push(leads[0] + n);
        } else if !fan.closed && fans[previous(fan.corners[n - 1]) as usize] == end {
            leads.push(n);
        }
        for pair in leads.windows(2) {
            // The edge in the middle, or the one nearest to it that is no diagonal.
            let middle = usize::midpoint(pair[0], pair[1]);
            let side = (pair[0]..=pair[1])
                .map(|k| (k.abs_diff(middle), fan.corners[k % n]))
                .filter(|&(_, side)| !self.is_diagonal(side))
                .min_by_key(|&(steps, _)| steps);
            let Some((_, side)) = side else { continue };
            let other = self.partner[side as usize];
            if other != NONE {
                self.open(side);
                self.edges.push(vec![side, other]);
                self.defects.opened_edges += 1;
            }
        }
    }

    /// Numbers what is joined, in the order of the first faces, and keeps the winding that most of
    /// the area has in the input.
    pub(super) fn components(&mut self, areas: &[f64]) -> Vec<u32> {
        let mut component = vec![NONE; self.faces.len()];
        let mut queue: Vec<u32> = Vec::new();
        let mut count = 0;
        for seed in 0..self.faces.len() {
            if component[seed] != NONE {
                continue;
            }
            queue.clear();
            queue.push(seed as u32);
            component[seed] = count;
            let mut head = 0;
            while let Some(&f) = queue.get(head) {
                head += 1;
                for side in 3 * f..3 * f + 3 {
                    let other = self.partner[side as usize];
                    if other != NONE && component[(other / 3) as usize] == NONE {
                        component[(other / 3) as usize] = count;
                        queue.push(other / 3);
                    }
                }
            }
            self.keep_majority(&queue, areas);
            count += 1;
        }
        component
    }
}

/// The corners around a vertex, in order; `closed` where the last is joined to the first.
struct Fan {
    corners: Vec<u32>,
    closed: bool,
}

/// Sets of patches that are joined, and whether each is turned over against the first of its set.
struct Parity {
    parent: Vec<(u32, bool)>,
}

impl Parity {
    fn new(count: usize) -> Self {
        Self {
            parent: (0..count as u32).map(|patch| (patch, false)).collect(),
        }
    }

    /// The first patch of the set, and whether the patch is turned over against it.
    fn find(&mut self, patch: u32) -> (u32, bool) {
        let (mut root, mut turned) = (patch, false);
        while self.parent[root as usize].0 != root {
            let (up, over) = self.parent[root as usize];
            turned ^= over;
            root = up;
        }
        let (mut at, mut rest) = (patch, turned);
        while at != root {
            let (up, over) = self.parent[at as usize];
            self.parent[at as usize] = (root, rest);
            rest ^= over;
            at = up;
        }
        (root, turned)
    }

    /// Joins two patches, `turned` against each other; false where they are joined otherwise.
    fn join(&mut self, patches: [u32; 2], turned: bool) -> bool {
        let [(one, over), (other, under)] = patches.map(|patch| self.find(patch));
        if one == other {
            return (over != under) == turned;
        }
        let (low, high) = (one.min(other), one.max(other));
        self.parent[high as usize] = (low, over ^ under ^ turned);
        true
    }
}
