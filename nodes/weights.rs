//! Weights of several things that are summed. Not a node: a param of `fuse` and `shortlist`.

use salient_sdk::NodeError;

/// Negative weights, as [`salient_sdk::Node::check`] reports them.
#[must_use]
pub fn check(weights: &[f64]) -> Vec<(&'static str, String)> {
    let bad = weights.iter().find(|w| **w < 0.0).map(|w| format!("a weight is {w}; it must be at least 0"));
    bad.map(|message| ("weights", message)).into_iter().collect()
}

/// Weights over their sum, of `count` things, which `of` names; no weights are equal ones.
pub fn shares(weights: &[f64], count: usize, of: &str) -> Result<Vec<f64>, NodeError> {
    let weights = if weights.is_empty() { vec![1.0; count] } else { weights.to_vec() };
    let total: f64 = weights.iter().sum();
    if weights.len() != count || total <= 0.0 {
        let message = format!("{} weights, summing to {total}, for {count} {of}", weights.len());
        return Err(NodeError::new(message).help("give one weight for each, not all 0"));
    }
    Ok(weights.into_iter().map(|weight| weight / total).collect())
}
