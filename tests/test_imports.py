"""How the modules of the three packages depend on each other."""

import grimp
import networkx as nx


def test_modules_do_not_import_each_other_in_a_cycle() -> None:
    graph = grimp.build_graph("semmap", "navgrid", "planner", exclude_type_checking_imports=True)
    imports = nx.DiGraph(
        (module, imported)
        for module in graph.modules
        for imported in graph.find_modules_directly_imported_by(module)
    )
    assert imports.number_of_edges() > 500
    assert [sorted(c) for c in nx.strongly_connected_components(imports) if len(c) > 1] == []
