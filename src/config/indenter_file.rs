//! The shipped indenters by themselves, without a plan that names them.

use super::builtin;
use super::lookup::Kind;
use crate::indenter::IndenterSpec;

/// Names and specs of the shipped indenters, in the order of their names.
pub fn shipped_indenters() -> Vec<(&'static str, IndenterSpec)> {
    let spec = |name| {
        let text = builtin::text(Kind::Indenter, name).expect("a name of the list has a text");
        toml::from_str(text).expect("the shipped indenters are read by the tests")
    };
    builtin::names(Kind::Indenter).map(|name| (name, spec(name))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_indenter_can_be_built() {
        let all = shipped_indenters();
        assert_eq!(all.len(), 21);
        for (name, spec) in all {
            crate::indenter::from_spec(name, &spec, None).unwrap_or_else(|e| panic!("{name}: {e}"));
        }
    }
}
