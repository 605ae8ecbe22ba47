"""A family of terms in a module of its own, as somebody would add one."""

import textwrap

from irbcal.measurement.column_names import declared
from irbcal.modeling import terms as package
from irbcal.modeling.terms import bases, families, inputs

NEW_FAMILY = textwrap.dedent('''
    """Creep: a joint that is far from its middle gives way."""

    import numpy as np

    from irbcal.modeling.terms.term import Basis, Family, Term, own_axis


    class Cubed(Basis):
        name = "cubed"

        def values(self, terms, here):
            return here.motion.q.T[[t.joint for t in terms]] ** 3

        def slopes(self, terms, here):
            out = np.zeros((len(terms), *here.motion.q.shape))
            for k, term in enumerate(terms):
                out[k, :, term.joint] = 3.0 * here.motion.q[:, term.joint] ** 2
            return out


    class Creep(Family):
        name = "creep"
        bases = (Cubed(),)

        def terms(self, arm):
            return [
                Term(j, own_axis(arm, j), "cubed", 1e-4, self.name, self.name) for j in range(len(arm.joint_names))
            ]


    FAMILY = Creep()
''')


def add(folder, monkeypatch, name="creep", text=NEW_FAMILY):
    """Add the family; `forget` after the path is as it was."""
    (folder / f"{name}.py").write_text(text)
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])
    forget()


def forget():
    """Look for families again."""
    for registry in (families, bases, inputs, declared):
        registry.cache_clear()
